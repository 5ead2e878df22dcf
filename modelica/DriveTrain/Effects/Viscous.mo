within DriveTrain.Effects;
model Viscous "Friction that grows with speed"
  extends Interfaces.SegmentEffect(dv=b * abs(friction.w));
  parameter Real b(unit="N.m.s/rad", min=0, max=10, nominal=0.01) = 0 "Viscous coefficient";
  annotation(__pycosim(size="b", needs="speeds",
    experiment="repeat the passes at three or more speeds, a decade apart"));
end Viscous;
