within DriveTrain.Effects;
model FrictionLag "Memory of friction: it acts against a speed that follows the true one late"
  extends Interfaces.SegmentEffect(ds=max(-1, min(1, friction.s + against - without)) - friction.s);
  parameter Real T(unit="s", min=1e-6, max=10, nominal=1e-2) = 1e-5 "Time constant of the lag";
  parameter Real ws(unit="rad/s", min=1e-4, max=100, nominal=1e-2) = 1e-2 "Late speed below which it turns over";
  Real v(unit="rad/s", start=0) "Late speed";
  Real against(unit="1") "Direction that friction acts against";
  Real without(unit="1") "The same without a lag";
equation
  T * der(v) = friction.w - v;
  against = max(-1, min(1, v / ws));
  without = max(-1, min(1, friction.w / ws));
  annotation(__pycosim(scan="T:lag; ws:creep", needs="reversals",
    experiment="reverse at once, without rest, slowly and fast"));
end FrictionLag;
