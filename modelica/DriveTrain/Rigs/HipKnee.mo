within DriveTrain.Rigs;
model HipKnee "Hip-knee actuation with the leg it moves"
  extends HipKneeTransmission;
  Components.Leg leg "Thigh and shank";
equation
  connect(hip.flange_b, leg.hip);
  connect(knee.flange_b, leg.knee);
  annotation(__pycosim(gravity_model="C_H C_K from motor1.phi motor2.phi push_H push_K",
    balance="push_H push_K from motor1.phi motor2.phi motor1.tau motor2.tau"));
end HipKnee;
