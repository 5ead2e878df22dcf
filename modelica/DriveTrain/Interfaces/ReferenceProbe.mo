within DriveTrain.Interfaces;
model ReferenceProbe "Errors of a reference as free parameters, to ask how sensitive the model is to them"
  Reference reference "Port of the joint";
  parameter Real dgain(unit="1") = 0 "Addition to the gain";
  parameter Real dC(unit="N.m") = 0 "Addition to the reference";
  parameter Real dphi(unit="rad") = 0 "Addition to the angle that a model of the load is given";
equation
  reference.dgain = -dgain;
  reference.dC = -dC;
  reference.dload = 0;
  reference.dphi = -dphi;
end ReferenceProbe;
