within DriveTrain.Interfaces;
partial model LinkMassEffect "Error of the mass of a link in a computed reference"
  LinkMass mass "Port of the link";
  Real error(unit="kg") = 0 "Addition in the reference";
equation
  mass.dmass = -error;
end LinkMassEffect;
