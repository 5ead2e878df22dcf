within DriveTrain.Effects;
model LoadDependence "Loss proportional to the load, where the model has none"
  extends Interfaces.SegmentEffect(dmu=mu - 1);
  parameter Real mu(unit="1", min=0.3, max=1, nominal=0.1) = 1 "Efficiency";
  annotation(__pycosim(size="mu", replaces="mu", needs="loads",
    experiment="repeat the passes with another payload or posture"));
end LoadDependence;
