within DriveTrain.Effects;
model Stribeck "Loss that falls as the lubricant film builds up with speed"
  extends Interfaces.SegmentEffect(df0=fs * exp(-(friction.w / ws)^2));
  parameter Real fs(unit="N.m", min=0, max=5, nominal=0.05) = 0 "Extra loss at standstill";
  parameter Real ws(unit="rad/s", min=1e-3, max=100, nominal=0.5) = 0.5 "Stribeck speed";
  annotation(__pycosim(size="fs", scan="ws:speed", needs="speeds",
    experiment="repeat the passes at five or more speeds, down to creeping"));
end Stribeck;
