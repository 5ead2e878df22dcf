within DriveTrain.Components;
model RelativeJoint "Joint between two links: absolute angle of the distal link to angle relative to the proximal link"
  Interfaces.Flange link "Distal link, absolute angle";
  Interfaces.Flange support "Proximal link";
  Interfaces.Flange joint "Joint, relative angle";
equation
  joint.phi = link.phi - support.phi;
  joint.tau + link.tau = 0;
  support.tau = -link.tau;
end RelativeJoint;
