within DriveTrain.Interfaces;
partial model PointEffect "Weight at a point of a link"
  Point point "Point of the link";
  Real weight(unit="N") = 0 "Force downwards";
equation
  point.f = -weight;
end PointEffect;
