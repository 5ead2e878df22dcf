within DriveTrain.Effects;
model JointSpring "Spring about a joint: hoses, cables, straps, tissue"
  extends Interfaces.JointEffect(torque=k * (beside.phi - q0));
  parameter Real k(unit="N.m/rad", min=0, max=1000, nominal=1) = 0 "Stiffness";
  parameter Real q0(unit="rad", min=-10, max=10, nominal=0.1) = 0 "Angle without torque";
  annotation(__pycosim(size="k", scan="q0:angle", needs="load_reference configurations",
    experiment="cross the workspace slowly along several lines, without load"));
end JointSpring;
