within DriveTrain.Components;
model Torque "Torque from outside on a flange"
  Interfaces.Flange flange "Loaded flange";
  input Real tau(unit="N.m") "Torque on the flange, positive accelerates it";
equation
  flange.tau = -tau;
end Torque;
