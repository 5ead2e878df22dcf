within DriveTrain.Components;
model CarriedLink "Second link of two, in a reference computed with errors"
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
  Real w_H(unit="rad/s") "Speed of the first joint";
  Real w_K(unit="rad/s") "Speed of the second joint";
  Real w2(unit="rad/s") "Absolute speed of the second link";
  Real a_H(unit="rad/s2") "Acceleration of the first joint";
  Real a2(unit="rad/s2") "Absolute acceleration of the second link";
  Real moment(unit="kg.m") "Error of mass times distance of the centre of mass";
  Real inertia(unit="kg.m2") "Error of the second link's inertia about the second joint";
  Real own(unit="N.m") "Error of the moment about the second joint";
  Real carried(unit="N.m") "Error of the torque on the angle of the first link";
equation
  mass.value = m;
  centre.value = c;
  first = hip.phi + tilt;
  second = hip.phi + knee.phi + tilt;
  error = hip.error + knee.error;
  w_H = der(hip.phi);
  w_K = der(knee.phi);
  a_H = der(w_H);
  w2 = w_H + w_K;
  a2 = der(w2);
  shifted1 = sin(first) * (cos(hip.error) - 1) + cos(first) * sin(hip.error);
  shifted2 = sin(second) * (cos(error) - 1) + cos(second) * sin(error);
  moment = mass.dmass * c + (m + mass.dmass) * centre.dcentre;
  inertia = moment * c + (m + mass.dmass) * (c + centre.dcentre) * centre.dcentre;
  own = g * (moment * sin(second) + (m + mass.dmass) * (c + centre.dcentre) * shifted2)
    + inertia * a2 + moment * l1 * (cos(knee.phi) * a_H + sin(knee.phi) * w_H * w_H);
  carried = g * l1 * (mass.dmass * sin(first) + (m + mass.dmass) * shifted1)
    + mass.dmass * l1 * l1 * a_H + moment * l1 * (cos(knee.phi) * a2 - sin(knee.phi) * w2 * w2);
  knee.dload = -own;
  hip.dload = -(own + carried);
  hip.dgain = 0;
  hip.dC = 0;
  hip.dphi = 0;
  knee.dgain = 0;
  knee.dC = 0;
  knee.dphi = 0;
end CarriedLink;
