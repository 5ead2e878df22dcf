within DriveTrain.Interfaces;
model LineProbe "Lost angle as a free parameter, to ask how sensitive the model is to it"
  Stretch line "Port of the line";
  parameter Real stretch(unit="rad") = 0 "Angle by which the far end lags behind, in motor units";
equation
  line.dphi = -stretch;
end LineProbe;
