within DriveTrain.Components;
model Joint "Joint between a transmission and its load, beside what else hangs on it"
  Interfaces.Flange flange_a "Transmission";
  Interfaces.Flange flange_b "Load";
  Interfaces.JointTorque beside "Port for effects";
  Interfaces.Reference reference "Port for errors of what the torque is compared with";
  Real tau(unit="N.m") "Torque of the transmission";
  Real load(unit="N.m") "Torque that the load takes";
  Real sensed(unit="N.m") "Torque as a sensor at the joint reads it";
  Real computed(unit="N.m") "Torque as a model of the load computes it";
equation
  flange_a.phi = flange_b.phi;
  flange_a.tau = tau;
  flange_b.tau = -load;
  tau = load + beside.dtau;
  beside.phi = flange_b.phi;
  reference.phi = flange_b.phi;
  reference.error = reference.dphi;
  reference.C = tau;
  reference.load = load;
  sensed = (1 + reference.dgain) * tau + reference.dC;
  computed = (1 + reference.dgain) * (load + reference.dload) + reference.dC;
end Joint;
