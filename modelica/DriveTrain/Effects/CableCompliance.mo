within DriveTrain.Effects;
model CableCompliance "Cable that stretches under its torque"
  extends Interfaces.LineEffect(stretch=e * line.tau);
  parameter Real e(unit="rad/(N.m)", min=0, max=1, nominal=1e-3) = 0 "Compliance, in motor units";
  annotation(__pycosim(size="e", needs="joint_encoders loads",
    experiment="log the joint encoders, and load the joint while the motor holds"));
end CableCompliance;
