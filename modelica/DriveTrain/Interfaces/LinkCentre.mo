within DriveTrain.Interfaces;
connector LinkCentre "Access to the centre of mass of a link that a computed reference knows"
  Real value(unit="m") "Centre of mass in the model of the machine";
  flow Real dcentre(unit="m") "Added to it in the reference";
end LinkCentre;
