within DriveTrain.Interfaces;
connector Friction "Access to the law of a segment: what an effect may read, and what it may add"
  Real phi(unit="rad") "Angle of the segment relative to its support";
  Real w(unit="rad/s") "Speed of the segment relative to its support";
  Real L(unit="N.m") "Mean load of the segment, (tau_in + tau_out) / 2";
  Real s(unit="1") "Friction state: sign of the speed when sliding, less in magnitude while sticking";
  Real f0(unit="N.m") "Load-independent loss of the segment without effects";
  Real mu(unit="1") "Efficiency of the segment with effects";
  flow Real dF(unit="N.m") "Added to the friction torque F";
  flow Real df0(unit="N.m") "Added to the load-independent loss f0";
  flow Real dv(unit="N.m") "Added to the part of F that does not depend on the load, which stays above zero";
  flow Real ds(unit="1") "Added to the friction state s";
  flow Real dmu(unit="1") "Added to the efficiency mu";
  flow Real dT(unit="N.m") "Added to the torque lost, s F, with a direction of its own";
end Friction;
