within DriveTrain.Effects;
model TorqueSaturation "Reading that is not proportional to the torque, as when the iron of a motor saturates"
  extends Interfaces.MotorEffect(dtau=k * signal.tau^3);
  parameter Real k(unit="1/(N.m)^2", min=-0.1, max=1, nominal=2e-3) = 0 "Change of the reading a squared torque";
  annotation(__pycosim(size="k", refines="torque_constant", needs="loads",
    experiment="hang three known loads or more on the joint, up to the peak torque"));
end TorqueSaturation;
