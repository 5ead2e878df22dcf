within DriveTrain.Components;
model Sensor "Torque that passes from flange_a to flange_b"
  Interfaces.Flange flange_a "Driving side";
  Interfaces.Flange flange_b "Driven side";
  Real tau(unit="N.m") "Torque passed on";
equation
  flange_a.phi = flange_b.phi;
  flange_a.tau = tau;
  flange_b.tau = -tau;
end Sensor;
