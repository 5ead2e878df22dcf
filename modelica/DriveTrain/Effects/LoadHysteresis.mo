within DriveTrain.Effects;
model LoadHysteresis "Load-dependent friction that builds up over a travel after each reversal"
  extends Interfaces.SegmentEffect(dT=c * abs(friction.L) * (z - friction.s) + m * friction.L * z^2);
  parameter Real h(unit="rad", min=1e-4, max=10, nominal=0.01) = 1e-3 "Travel over which it builds up";
  parameter Real mu_dif(unit="1", min=-0.5, max=0.5, nominal=0.01) = 0 "Difference between driving and driven loads";
  Real z(unit="1", min=-1, max=1, start=0) "Friction state of the load term";
protected
  Real c(unit="1") "Load term of the segment";
  Real m(unit="1") "Difference, at most the load term: friction takes power, it gives none";
equation
  c = 2 * (1 - friction.mu) / (1 + friction.mu);
  m = max(-c, min(c, mu_dif));
  h * der(z) = friction.w - abs(friction.w) * z;
  annotation(__pycosim(size="mu_dif", scan="h:travel", refines="presliding", needs="reversals",
    experiment="reverse under load, slowly, many times"));
end LoadHysteresis;
