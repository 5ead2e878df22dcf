within DriveTrain.Rigs;
model HipKnee "Hip-knee actuation with the leg it moves"
  extends HipKneeTransmission;
  Components.Leg leg "Thigh and shank";
  Components.Mount mount(l1=leg.l1, tilt=leg.tilt) "Where a payload hangs";
equation
  connect(hip.flange_b, leg.hip);
  connect(knee.flange_b, leg.knee);
  connect(mount.hip, hip.beside);
  connect(mount.knee, knee.beside);
  annotation(__pycosim(gravity_model="C_H C_K from motor1.phi motor2.phi push_H push_K",
    balance="push_H push_K from motor1.phi motor2.phi motor1.tau motor2.tau",
    places="1A=s1A 2A=s2A 1B=s1B 2B=s2B shank=mount"));
end HipKnee;
