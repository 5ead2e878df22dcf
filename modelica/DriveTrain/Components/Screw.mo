within DriveTrain.Components;
model Screw "Ideal lead screw with the mass of its nut"
  Interfaces.Flange flange "Screw";
  Interfaces.TranslationalFlange nut "Nut; its load hangs here";
  parameter Real lead(unit="m", min=1e-5, max=0.1, nominal=1e-3) = 2e-3 "Travel of the nut a revolution";
  parameter Real m(unit="kg", min=0, max=100, nominal=0.1) = 0.096 "Mass of the nut and what it carries";
  Real v(unit="m/s") "Speed of the nut";
  Real a(unit="m/s2") "Acceleration of the nut";
protected
  Real f(unit="N") "Axial force of the screw on the nut";
equation
  nut.s = lead / 6.283185307179586 * flange.phi;
  v = der(nut.s);
  a = der(v);
  m * a = f + nut.f;
  flange.tau = lead / 6.283185307179586 * f;
  annotation(__pycosim(links="flange: mass=m, moment=0, inertia=m*(lead/6.283185307179586)**2"));
end Screw;
