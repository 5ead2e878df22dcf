within DriveTrain.Interfaces;
connector LinkMass "Access to the mass of a link that a computed reference knows"
  Real value(unit="kg") "Mass in the model of the machine";
  flow Real dmass(unit="kg") "Added to it in the reference";
end LinkMass;
