within DriveTrain.Effects;
model DirectionAsymmetry "Loss that differs between the two directions of motion"
  extends Interfaces.SegmentEffect(df0=a * friction.s * friction.f0);
  parameter Real a(unit="1", min=-1, max=1, nominal=0.1) = 0 "Relative difference";
  annotation(__pycosim(size="a", needs="directions",
    experiment="move the same line out and back, under loads of both signs"));
end DirectionAsymmetry;
