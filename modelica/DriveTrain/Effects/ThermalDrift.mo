within DriveTrain.Effects;
model ThermalDrift "Loss that falls as the machine warms up"
  extends Interfaces.SegmentEffect(df0=friction.f0 * k * exp(-time / T));
  parameter Real k(unit="1", min=0, max=20, nominal=0.1) = 0 "Relative extra loss when cold";
  parameter Real T(unit="s", min=0.1, max=1e5, nominal=100) = 100 "Time constant of the warm-up";
  annotation(__pycosim(size="k", scan="T:time", place="system", needs="time",
    experiment="repeat the same pass from cold, for as long as the warm-up takes"));
end ThermalDrift;
