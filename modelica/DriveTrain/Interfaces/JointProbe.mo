within DriveTrain.Interfaces;
model JointProbe "Torque beside the load as a free parameter, to ask how sensitive the model is to it"
  JointTorque beside "Port of the joint";
  parameter Real torque(unit="N.m") = 0 "Torque beside that of the load";
equation
  beside.dtau = -torque;
end JointProbe;
