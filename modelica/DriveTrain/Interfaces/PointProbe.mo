within DriveTrain.Interfaces;
model PointProbe "Weight as a free parameter, to ask how sensitive the model is to it"
  Point point "Point of the link";
  parameter Real weight(unit="N") = 0 "Force downwards";
equation
  point.f = -weight;
end PointProbe;
