within DriveTrain.Effects;
model Presliding "Compliance of the contact: friction builds up over a travel after each reversal"
  extends Interfaces.SegmentEffect(ds=x - friction.s);
  parameter Real travel(unit="rad", min=1e-4, max=10, nominal=0.01) = 1e-3 "Travel over which friction builds up";
  Real x(unit="1", min=-1, max=1, start=0) "Friction state with the longer travel";
equation
  travel * der(x) = friction.w - abs(friction.w) * x;
  annotation(__pycosim(scan="travel:travel", needs="reversals",
    experiment="reverse slowly, with dwell, many times"));
end Presliding;
