within DriveTrain.Effects;
model TimeDelay "Torques recorded later than the angles, or earlier, as filters and buses do"
  extends Interfaces.ChannelEffect(delay=d);
  parameter Real d(unit="s", min=-0.2, max=0.2, nominal=1e-2) = 0 "Delay; negative where torques are recorded earlier";
  annotation(__pycosim(scan="d:delay", needs="accelerations",
    experiment="reverse and accelerate hard, with a load that changes along the pass"));
end TimeDelay;
