within DriveTrain.Interfaces;
connector Point "Point of a link where a weight may hang"
  Real y(unit="m") "Height";
  flow Real f(unit="N") "Weight that hangs there";
end Point;
