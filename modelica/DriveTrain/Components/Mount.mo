within DriveTrain.Components;
model Mount "Point of the shank where a payload hangs, beside the leg"
  Interfaces.JointTorque hip "Hip flexion, thigh angle from the vertical";
  Interfaces.JointTorque knee "Knee extension, shank angle is hip + knee";
  Interfaces.Point point "Port for effects";
  parameter Real l1(unit="m", min=0, max=2, nominal=0.1) = 0.42 "Length of the thigh";
  parameter Real distance(unit="m", min=0, max=2, nominal=0.1) = 0.40 "Knee to the point";
  parameter Real tilt(unit="rad", min=-3.2, max=3.2, nominal=0.1) = 0 "Tilt of the base from the vertical";
equation
  point.y = -l1 * cos(hip.phi + tilt) - distance * cos(hip.phi + knee.phi + tilt);
  hip.dtau = -point.f * (l1 * sin(hip.phi + tilt) + distance * sin(hip.phi + knee.phi + tilt)) "Virtual work";
  knee.dtau = -point.f * distance * sin(hip.phi + knee.phi + tilt);
end Mount;
