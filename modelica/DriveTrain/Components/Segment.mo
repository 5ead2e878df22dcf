within DriveTrain.Components;
model Segment "Transmission segment with load-dependent friction, direct and reverse, all four quadrants"
  Interfaces.Flange flange_a "Driving side";
  Interfaces.Flange flange_b "Driven side";
  Interfaces.Flange support "Link that carries the bearings";
  Interfaces.Friction friction "Port for effects";
  parameter Real f0(unit="N.m", min=0, max=1, nominal=0.05) = 0.05 "Load-independent loss";
  parameter Real mu(unit="1", min=0.3, max=1, nominal=0.1) = 0.95 "Efficiency of the load-dependent loss";
  parameter Real travel(unit="rad", min=1e-5, max=10, nominal=1e-3) = 1e-3 "Elastic displacement before sliding";
  parameter Real elastic(unit="1", min=0, max=0.99, nominal=0.1) = 0.9 "Friction state below which nothing slides";
  parameter Real damping(unit="s", min=0, max=1, nominal=1e-3) = 2e-3 "Time constant that damps the displacement";
  Real w(unit="rad/s") "Speed relative to the support";
  Real z(unit="1", min=-1, max=1, start=0) "Friction state: elastic displacement over travel";
  Real s(unit="1") "Friction state with its damping and effects";
  Real L(unit="N.m") "Mean load";
  Real load(unit="N.m") = L "Load that friction grows with: the mean of both ends, unless a rig says otherwise";
  Real F(unit="N.m") "Friction torque, not negative";
  Real loss(unit="W") "Power lost (and stored in the elastic displacement)";
protected
  Real phi(unit="rad") "Angle relative to the support";
  Real slip(unit="1") "Share of the motion that slides, with the sign of z";
  Real rate(unit="1/s") "Rate of the friction state";
  Real held(unit="1") "Friction state with its damping, without effects";
  Real f(unit="N.m") "Load-independent loss with effects, floored at zero";
  Real m(unit="1") "Efficiency with effects";
equation
  flange_a.phi = flange_b.phi;
  phi = flange_a.phi - support.phi;
  w = der(phi);
  slip = (z - max(-elastic, min(elastic, z))) / (1 - elastic);
  travel * rate = w - (abs(w) * slip + w * abs(slip)) / 2 "Dupont et al. (2002): slides onwards only, never back";
  der(z) = rate;
  held = max(-1, min(1, z + damping * rate)) "Damped, yet never above what breaks it away";
  s = held + friction.ds;
  f = max(0, f0 + friction.df0);
  m = mu + friction.dmu;
  F = max(0, 2 * m * f / (1 + m) + friction.dv) + 2 * (1 - m) / (1 + m) * abs(load) + friction.dF
    "Nobili et al., Eq. (friction_model)";
  flange_a.tau = L + (s * F + friction.dT) / 2;
  flange_b.tau = -(L - (s * F + friction.dT) / 2);
  flange_a.tau + flange_b.tau + support.tau = 0;
  loss = (s * F + friction.dT) * w;
  friction.phi = phi;
  friction.w = w;
  friction.L = L;
  friction.s = held;
  friction.f0 = f0;
  friction.mu = m;
end Segment;
