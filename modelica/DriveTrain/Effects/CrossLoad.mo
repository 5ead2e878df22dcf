within DriveTrain.Effects;
model CrossLoad "Friction from the load of the other line, as cables that share pulleys or bearings have"
  extends Interfaces.PairEffect(dF=k * abs(partner.L));
  parameter Real k(unit="1", min=0, max=0.5, nominal=0.01) = 0 "Share of the partner's load";
  annotation(__pycosim(size="k", needs="loads",
    experiment="load one line, then the other, over the same motion"));
end CrossLoad;
