within DriveTrain.Effects;
model StribeckAsymmetry "Loss that falls with speed, more in one direction than in the other"
  extends Interfaces.SegmentEffect(df0=fs_a * friction.s * exp(-(friction.w / ws)^2));
  parameter Real fs_a(unit="N.m", min=-5, max=5, nominal=0.05) = 0 "Half the difference between both directions";
  parameter Real ws(unit="rad/s", min=1e-3, max=100, nominal=0.5) = 0.5 "Stribeck speed";
  annotation(__pycosim(size="fs_a", scan="ws:speed", refines="direction_asymmetry", needs="speeds directions",
    experiment="repeat the passes out and back at five or more speeds, down to creeping"));
end StribeckAsymmetry;
