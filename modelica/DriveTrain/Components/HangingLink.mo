within DriveTrain.Components;
model HangingLink "Link on a fixed joint, in a reference computed with errors"
  Interfaces.Reference joint "Joint, angle from the vertical";
  Interfaces.LinkMass mass "Port for an error of the mass; one of the centre of mass would do nearly the same";
  parameter Real m(unit="kg", min=0, max=50, nominal=1) = 1 "Mass";
  parameter Real c(unit="m", min=0, max=2, nominal=0.1) = 0.1 "Joint to centre of mass";
  parameter Real arm(unit="kg.m", min=0, max=10, nominal=0.01) = 0 "Moment beside the one of the mass";
  parameter Real g(unit="m/s2") = 9.80665 "Gravity";
  parameter Real tilt(unit="rad", min=-3.2, max=3.2, nominal=0.1) = 0 "Tilt of the base from the vertical";
protected
  Real angle(unit="rad") "Angle from the vertical";
  Real w(unit="rad/s") "Speed of the joint";
  Real a(unit="rad/s2") "Acceleration of the joint";
  Real shifted(unit="1") "Change of the angle's sine by the error of the angle";
equation
  mass.value = m;
  angle = joint.phi + tilt;
  w = der(joint.phi);
  a = der(w);
  shifted = sin(angle) * (cos(joint.error) - 1) + cos(angle) * sin(joint.error);
  joint.dload = -(mass.dmass * c * (g * sin(angle) + c * a) + g * ((m + mass.dmass) * c + arm) * shifted);
  joint.dgain = 0;
  joint.dC = 0;
  joint.dphi = 0;
end HangingLink;
