within DriveTrain.Rigs;
model HipKnee "Hip-knee actuation with the leg it moves"
  extends HipKneeTransmission;
  Components.Leg leg "Thigh and shank";
  Components.Mount mount(l1=leg.l1, tilt=leg.tilt) "Where a payload hangs";
  Components.HangingLink thigh_model(m=leg.m1, c=leg.c1, tilt=leg.tilt) "Thigh that a computed reference knows";
  Components.CarriedLink shank_model(m=leg.m2, c=leg.c2, l1=leg.l1, tilt=leg.tilt) "Shank that it knows";
equation
  connect(hip.flange_b, leg.hip);
  connect(knee.flange_b, leg.knee);
  connect(mount.hip, hip.beside);
  connect(mount.knee, knee.beside);
  connect(thigh_model.joint, hip.reference);
  connect(shank_model.hip, hip.reference);
  connect(shank_model.knee, knee.reference);
  annotation(__pycosim(gravity_model="C_H C_K from motor1.phi motor2.phi push_H push_K",
    balance="push_H push_K from motor1.phi motor2.phi motor1.tau motor2.tau",
    places="1A=s1A 2A=s2A 1B=s1B 2B=s2B shank=mount shank=shank_model thigh=thigh_model"));
end HipKnee;
