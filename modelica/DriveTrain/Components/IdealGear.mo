within DriveTrain.Components;
model IdealGear "Ideal gear on a support"
  Interfaces.Flange flange_a "Fast side";
  Interfaces.Flange flange_b "Slow side";
  Interfaces.Flange support "Housing";
  parameter Real ratio(unit="1") = 1 "Angle of flange_a over angle of flange_b, both relative to the support";
equation
  flange_a.phi - support.phi = ratio * (flange_b.phi - support.phi);
  0 = ratio * flange_a.tau + flange_b.tau;
  0 = flange_a.tau + flange_b.tau + support.tau;
end IdealGear;
