within DriveTrain.Effects;
model TorqueConstant "Wrong scale of the torque channel"
  extends Interfaces.MotorEffect(dtau=(g - 1) * signal.tau);
  parameter Real g(unit="1", min=0.5, max=2, nominal=0.1) = 1 "Measured over true torque";
  annotation(__pycosim(size="g", needs="loads",
    experiment="hang a known load on the joint"));
end TorqueConstant;
