within DriveTrain.Components;
model Segment "Transmission segment with load-dependent friction, direct and reverse, all four quadrants"
  Interfaces.Flange flange_a "Driving side";
  Interfaces.Flange flange_b "Driven side";
  Interfaces.Flange support "Link that carries the bearings";
  Interfaces.Friction friction "Port for effects";
  parameter Real f0(unit="N.m", min=0, max=1, nominal=0.05) = 0.05 "Load-independent loss";
  parameter Real mu(unit="1", min=0.3, max=1, nominal=0.1) = 0.95 "Efficiency of the load-dependent loss";
  parameter Real travel(unit="rad", min=1e-5, max=10, nominal=1e-3) = 1e-3 "Elastic displacement before sliding";
  Real w(unit="rad/s") "Speed relative to the support";
  Real z(unit="1", min=-1, max=1, start=0) "Friction state: elastic displacement over travel";
  Real s(unit="1") "Friction state with effects";
  Real L(unit="N.m") "Mean load";
  Real F(unit="N.m") "Friction torque, not negative";
  Real loss(unit="W") "Power lost (and stored in the elastic displacement)";
protected
  Real phi(unit="rad") "Angle relative to the support";
  Real f(unit="N.m") "Load-independent loss with effects, floored at zero";
  Real m(unit="1") "Efficiency with effects";
equation
  flange_a.phi = flange_b.phi;
  phi = flange_a.phi - support.phi;
  w = der(phi);
  travel * der(z) = w - abs(w) * z "Elastic displacement, saturating at the sign of w";
  s = z + friction.ds;
  f = max(0, f0 + friction.df0);
  m = mu + friction.dmu;
  F = 2 * m * f / (1 + m) + 2 * (1 - m) / (1 + m) * abs(L) + friction.dF "Nobili et al., Eq. (friction_model)";
  flange_a.tau = L + (s * F + friction.dT) / 2;
  flange_b.tau = -(L - (s * F + friction.dT) / 2);
  flange_a.tau + flange_b.tau + support.tau = 0;
  loss = (s * F + friction.dT) * w;
  friction.w = w;
  friction.L = L;
  friction.s = z;
  friction.f0 = f0;
  friction.mu = m;
end Segment;
