within DriveTrain.Interfaces;
model LineProbe "Lost angle as a free parameter, to ask how sensitive the model is to it"
  Stretch line "Port of the line";
  parameter Real stretch(unit="rad") = 0 "Angle by which the far end lags behind, in motor units";
  parameter Real drag(unit="N.m") = 0 "Torque lost on the way";
equation
  line.dtau = -drag;
  line.dphi = -stretch;
end LineProbe;
