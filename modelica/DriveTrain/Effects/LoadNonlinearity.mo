within DriveTrain.Effects;
model LoadNonlinearity "Loss that grows with the square of the load"
  extends Interfaces.SegmentEffect(dF=d * friction.L^2);
  parameter Real d(unit="1/(N.m)", min=0, max=10, nominal=0.05) = 0 "Coefficient of the squared load";
  annotation(__pycosim(size="d", refines="load_dependence", needs="loads",
    experiment="repeat the passes with three payloads or more"));
end LoadNonlinearity;
