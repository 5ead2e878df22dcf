within DriveTrain.Interfaces;
partial model MotorEffect "Changes the torque of one motor, or what is measured of it"
  Flange flange "Rotor of the motor";
  TorqueSignal signal "Torque channel of the motor";
  Real dtau(unit="N.m") = 0 "Addition to the measured torque";
  Real loss(unit="N.m") = 0 "Torque taken from the shaft";
equation
  signal.dtau = -dtau;
  flange.tau = loss;
end MotorEffect;
