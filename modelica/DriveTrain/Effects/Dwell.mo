within DriveTrain.Effects;
model Dwell "Breakaway torque that grows with the time at rest, and is lost over a travel"
  extends Interfaces.SegmentEffect(dF=fd * rested);
  parameter Real fd(unit="N.m", min=0, max=5, nominal=0.05) = 0 "Friction added by a long rest";
  parameter Real T(unit="s", min=1e-3, max=1e3, nominal=1) = 1 "Time constant of its growth";
  parameter Real h(unit="rad", min=1e-4, max=10, nominal=0.01) = 1e-2 "Travel over which it is lost";
  Real rested(unit="1", min=0, max=1, start=0) "Share of it that the contact has grown";
  Real rests(unit="1") "One at rest, none where a tenth of the travel is passed within the time constant";
equation
  rests = max(0, 1 - 10 * abs(friction.w) * T / h);
  der(rested) = rests * (1 - rested) / T - abs(friction.w) * rested / h;
  annotation(__pycosim(size="fd", scan="h:travel; T:rest", needs="reversals",
    experiment="start from rests of different lengths, slowly, many times"));
end Dwell;
