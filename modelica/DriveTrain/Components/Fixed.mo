within DriveTrain.Components;
model Fixed "Flange held at a fixed angle"
  Interfaces.Flange flange "Held flange";
  parameter Real phi0(unit="rad") = 0 "Angle";
equation
  flange.phi = phi0;
end Fixed;
