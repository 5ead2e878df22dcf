within DriveTrain.Effects;
model LowPass "Torques that a filter of first order has smoothed and held back"
  extends Interfaces.ChannelEffect(lag=T);
  parameter Real T(unit="s", min=0, max=10, nominal=1e-2) = 0 "Time constant";
  annotation(__pycosim(scan="T:lag", needs="accelerations",
    experiment="reverse and accelerate hard, with a load that changes along the pass"));
end LowPass;
