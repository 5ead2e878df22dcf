within DriveTrain.Interfaces;
partial model ReferenceEffect "Error of what the torque of a joint is compared with"
  Reference reference "Port of the joint";
  Real dgain(unit="1") = 0 "Addition to the gain";
  Real dC(unit="N.m") = 0 "Addition to the reference";
  Real dphi(unit="rad") = 0 "Addition to the angle that a model of the load is given";
  Real lag(unit="s") = 0 "Time constant of a first-order lag of what was recorded";
equation
  reference.dgain = -dgain;
  reference.dC = -dC;
  reference.dload = 0;
  reference.dphi = -dphi;
end ReferenceEffect;
