within DriveTrain.Interfaces;
model SegmentProbe "Additions to the law of a segment as free parameters, to ask how sensitive the model is to them"
  Friction friction "Port of the segment";
  parameter Real dF(unit="N.m") = 0 "Addition to the friction torque";
  parameter Real df0(unit="N.m") = 0 "Addition to the load-independent loss";
  parameter Real dv(unit="N.m") = 0 "Addition to the part of the friction torque without the load";
  parameter Real ds(unit="1") = 0 "Addition to the friction state";
  parameter Real dmu(unit="1") = 0 "Addition to the efficiency";
  parameter Real dT(unit="N.m") = 0 "Addition to the torque lost, with a direction of its own";
equation
  friction.dF = -dF;
  friction.df0 = -df0;
  friction.dv = -dv;
  friction.ds = -ds;
  friction.dmu = -dmu;
  friction.dT = -dT;
end SegmentProbe;
