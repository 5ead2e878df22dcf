within DriveTrain.Interfaces;
model LinkMassProbe "Error of the mass of a link as a free parameter, to ask what the model makes of it"
  LinkMass mass "Port of the link";
  parameter Real error(unit="kg") = 0 "Addition in the reference";
equation
  mass.dmass = -error;
end LinkMassProbe;
