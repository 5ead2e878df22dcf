within DriveTrain.Interfaces;
partial model LinkCentreEffect "Error of the centre of mass of a link in a computed reference"
  LinkCentre centre "Port of the link";
  Real error(unit="m") = 0 "Addition in the reference";
equation
  centre.dcentre = -error;
end LinkCentreEffect;
