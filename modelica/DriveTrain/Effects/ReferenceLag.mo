within DriveTrain.Effects;
model ReferenceLag "Reference that a filter of first order has smoothed and held back"
  extends Interfaces.ReferenceEffect(lag=T);
  parameter Real T(unit="s", min=0, max=10, nominal=1e-2) = 0 "Time constant";
  annotation(__pycosim(scan="T:lag", needs="accelerations",
    experiment="read the unfiltered signal, or reverse and accelerate hard"));
end ReferenceLag;
