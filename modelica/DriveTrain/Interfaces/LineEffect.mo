within DriveTrain.Interfaces;
partial model LineEffect "Angle that a line loses between its motor and the joint"
  Stretch line "Port of the line";
  Real stretch(unit="rad") = 0 "Angle by which the far end lags behind, in motor units";
  Real drag(unit="N.m") = 0 "Torque lost on the way";
equation
  line.dtau = -drag;
  line.dphi = -stretch;
end LineEffect;
