within DriveTrain.Components;
model Inertia "Rotating inertia"
  Interfaces.Flange flange "Shaft";
  parameter Real J(unit="kg.m2", min=0, max=10, nominal=1e-3) = 0 "Moment of inertia";
  Real w(unit="rad/s") "Speed";
  Real a(unit="rad/s2") "Acceleration";
equation
  w = der(flange.phi);
  a = der(w);
  J * a = flange.tau;
  annotation(__pycosim(links="flange: inertia=J"));
end Inertia;
