within DriveTrain.Effects;
model ViscousAsymmetry "Friction that grows with speed, more in one direction than in the other"
  extends Interfaces.SegmentEffect(dv=b_a * friction.w);
  parameter Real b_a(unit="N.m.s/rad", min=-10, max=10, nominal=0.01) = 0 "Half the difference between both directions";
  annotation(__pycosim(size="b_a", needs="speeds directions",
    experiment="move the same line out and back at three speeds or more, a decade apart"));
end ViscousAsymmetry;
