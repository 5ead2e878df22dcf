model DoublePendulum "Two links in a vertical plane, a quasi-direct drive with friction at each joint"
  input Real tau1(unit="N.m") "Torque of the shoulder's drive, at the joint";
  input Real tau2(unit="N.m") "Torque of the elbow's drive, at the joint";
  DriveTrain.Components.Motor motor1 "Drive of the shoulder";
  DriveTrain.Components.Motor motor2 "Drive of the elbow";
  DriveTrain.Components.Segment shoulder(mu=1) "Gear and bearings of the shoulder, without a load term";
  DriveTrain.Components.Segment elbow(mu=1) "Gear and bearings of the elbow, without a load term";
  DriveTrain.Effects.Viscous viscous_shoulder(b=0.01) "Viscous friction of the shoulder";
  DriveTrain.Effects.Viscous viscous_elbow(b=0.01) "Viscous friction of the elbow";
  DriveTrain.Components.Fixed frame "Frame; the elbow's angle counts from the upper link";
  DriveTrain.Components.Leg links(m1=0.6, c1=0.2, l1=0.3, I1=0.03, m2=0.6, c2=0.15, I2=0.01)
    "Upper link, hanging at zero, and lower link";
equation
  motor1.tau = tau1;
  motor2.tau = tau2;
  connect(motor1.flange, shoulder.flange_a);
  connect(shoulder.flange_b, links.hip);
  connect(shoulder.support, frame.flange);
  connect(viscous_shoulder.friction, shoulder.friction);
  connect(motor2.flange, elbow.flange_a);
  connect(elbow.flange_b, links.knee);
  connect(elbow.support, frame.flange);
  connect(viscous_elbow.friction, elbow.friction);
  annotation(__pycosim(
    estimate="motor1.tau motor2.tau from motor1.phi motor2.phi",
    compensate="motor1.tau motor2.tau from motor1.phi motor2.phi",
    simulate="motor1.phi motor2.phi from tau1 tau2",
    joined="motor1+motor2",
    channels="torque=motor1+motor2"));
end DoublePendulum;
