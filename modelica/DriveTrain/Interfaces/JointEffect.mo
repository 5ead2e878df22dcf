within DriveTrain.Interfaces;
partial model JointEffect "Torque that a joint takes beside its load"
  JointTorque beside "Port of the joint";
  Real torque(unit="N.m") = 0 "Torque that the transmission has to give beside that of the load";
equation
  beside.dtau = -torque;
end JointEffect;
