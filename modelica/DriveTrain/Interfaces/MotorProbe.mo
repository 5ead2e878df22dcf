within DriveTrain.Interfaces;
model MotorProbe "Additions to a torque channel as free parameters, to ask how sensitive the model is to them"
  TorqueSignal signal "Torque channel of the motor";
  parameter Real dtau(unit="N.m") = 0 "Addition to the measured torque";
equation
  signal.dtau = -dtau;
end MotorProbe;
