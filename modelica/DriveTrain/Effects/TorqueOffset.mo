within DriveTrain.Effects;
model TorqueOffset "Constant error of the torque channel"
  extends Interfaces.MotorEffect(dtau=o);
  parameter Real o(unit="N.m", min=-5, max=5, nominal=0.01) = 0 "Offset";
  annotation(__pycosim(size="o", needs="directions",
    experiment="hold loads of both signs while moving both ways"));
end TorqueOffset;
