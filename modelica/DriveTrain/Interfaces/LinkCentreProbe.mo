within DriveTrain.Interfaces;
model LinkCentreProbe "Error of the centre of mass of a link as a free parameter, to ask what the model makes of it"
  LinkCentre centre "Port of the link";
  parameter Real error(unit="m") = 0 "Addition in the reference";
equation
  centre.dcentre = -error;
end LinkCentreProbe;
