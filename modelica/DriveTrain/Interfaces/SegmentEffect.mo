within DriveTrain.Interfaces;
partial model SegmentEffect "Changes the law of one segment from inside"
  Friction friction "Port of the segment";
  Real dF(unit="N.m") = 0 "Addition to the friction torque";
  Real df0(unit="N.m") = 0 "Addition to the load-independent loss";
  Real dv(unit="N.m") = 0 "Addition to the part of the friction torque that does not depend on the load";
  Real ds(unit="1") = 0 "Addition to the friction state";
  Real dmu(unit="1") = 0 "Addition to the efficiency";
  Real dT(unit="N.m") = 0 "Addition to the torque lost, with a direction of its own";
equation
  friction.dF = -dF;
  friction.df0 = -df0;
  friction.dv = -dv;
  friction.ds = -ds;
  friction.dmu = -dmu;
  friction.dT = -dT;
end SegmentEffect;
