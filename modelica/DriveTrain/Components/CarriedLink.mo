within DriveTrain.Components;
model CarriedLink "Gravity of the second link of two, in a reference computed with errors"
  Interfaces.Reference hip "First joint, angle from the vertical";
  Interfaces.Reference knee "Second joint, relative to the first link";
  Interfaces.LinkMass mass "Port for an error of the mass";
  Interfaces.LinkCentre centre "Port for an error of the centre of mass";
  parameter Real m(unit="kg", min=0, max=50, nominal=1) = 3.2 "Mass";
  parameter Real c(unit="m", min=0, max=2, nominal=0.1) = 0.15 "Second joint to centre of mass";
  parameter Real l1(unit="m", min=0, max=2, nominal=0.1) = 0.42 "Length of the first link";
  parameter Real g(unit="m/s2") = 9.80665 "Gravity";
  parameter Real tilt(unit="rad", min=-3.2, max=3.2, nominal=0.1) = 0 "Tilt of the base from the vertical";
protected
  Real first(unit="rad") "Angle of the first link from the vertical";
  Real second(unit="rad") "Angle of the second link from the vertical";
  Real error(unit="rad") "Error of the second link's angle";
  Real shifted1(unit="1") "Change of the first angle's sine by the error of the angle";
  Real shifted2(unit="1") "Change of the second angle's sine by the error of the angles";
  Real own(unit="N.m") "Error of the moment about the second joint";
equation
  mass.value = m;
  centre.value = c;
  first = hip.phi + tilt;
  second = hip.phi + knee.phi + tilt;
  error = hip.error + knee.error;
  shifted1 = sin(first) * (cos(hip.error) - 1) + cos(first) * sin(hip.error);
  shifted2 = sin(second) * (cos(error) - 1) + cos(second) * sin(error);
  own = g * ((mass.dmass * c + (m + mass.dmass) * centre.dcentre) * sin(second)
    + (m + mass.dmass) * (c + centre.dcentre) * shifted2);
  knee.dload = -own;
  hip.dload = -(own + g * l1 * (mass.dmass * sin(first) + (m + mass.dmass) * shifted1));
  hip.dgain = 0;
  hip.dC = 0;
  hip.dphi = 0;
  knee.dgain = 0;
  knee.dC = 0;
  knee.dphi = 0;
end CarriedLink;
