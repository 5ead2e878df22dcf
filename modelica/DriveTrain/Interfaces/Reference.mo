within DriveTrain.Interfaces;
connector Reference "Access to what the torque of a joint is compared with: a sensor, or a model of the load"
  Real phi(unit="rad") "Angle of the joint";
  Real error(unit="rad") "Error of the angle that a model of the load is given";
  Real C(unit="N.m") "Torque of the transmission";
  Real load(unit="N.m") "Torque that the load takes";
  flow Real dgain(unit="1") "Added to the gain of the reference";
  flow Real dC(unit="N.m") "Added to the reference";
  flow Real dload(unit="N.m") "Added to a reference that a model of the load computes";
  flow Real dphi(unit="rad") "Added to the angle that a model of the load is given";
end Reference;
