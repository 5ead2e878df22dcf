within DriveTrain.Components;
model Joint "Joint between a transmission and its load, beside what else hangs on it"
  Interfaces.Flange flange_a "Transmission";
  Interfaces.Flange flange_b "Load";
  Interfaces.JointTorque beside "Port for effects";
  Real tau(unit="N.m") "Torque of the transmission";
  Real load(unit="N.m") "Torque that the load takes";
equation
  flange_a.phi = flange_b.phi;
  flange_a.tau = tau;
  flange_b.tau = -load;
  tau = load + beside.dtau;
  beside.phi = flange_b.phi;
end Joint;
