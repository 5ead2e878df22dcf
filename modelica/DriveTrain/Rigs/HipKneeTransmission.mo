within DriveTrain.Rigs;
model HipKneeTransmission "Cable-driven differential of an exoskeleton's hip and knee, joint flanges free"
  parameter Real t_r(unit="1", min=0.01, max=1e4, nominal=10) = 15.125 "Ratio between motors and joints";
  input Real tau1(unit="N.m") "Torque of motor 1, k_m Iq";
  input Real tau2(unit="N.m") "Torque of motor 2, k_m Iq";
  input Real push_H(unit="N.m") "Torque from outside on the hip";
  input Real push_K(unit="N.m") "Torque from outside on the knee";
  Components.Motor motor1(tau=tau1) "Motor of line 1";
  Components.Motor motor2(tau=tau2) "Motor of line 2";
  Components.Segment s1A "Proximal stage of line 1";
  Components.Segment s2A "Proximal stage of line 2";
  Components.Segment s1B "Distal stage of line 1";
  Components.Segment s2B "Distal stage of line 2";
  Components.Fixed pelvis "Pelvis, carries motors and proximal stages";
  Components.CrossedRouting crossing "Line 2 is routed crossed about the thigh";
  Components.IdealGear thigh(ratio=t_r) "Thigh, in motor units to joint units";
  Components.IdealGear shank(ratio=t_r) "Shank, in motor units to joint units";
  Components.RelativeJoint joint "Knee between thigh and shank";
  Components.Torque outside_H(tau=push_H) "Torque from outside on the hip";
  Components.Torque outside_K(tau=push_K) "Torque from outside on the knee";
  Real q_H(unit="rad") "Hip flexion";
  Real q_K(unit="rad") "Knee extension";
  Real C_H(unit="N.m") "Torque of the transmission on the hip";
  Real C_K(unit="N.m") "Torque of the transmission on the knee";
  Components.Joint hip "Hip joint; its load hangs on flange_b";
  Components.Joint knee "Knee joint; its load hangs on flange_b";
  Components.Line line1 "Line 1";
  Components.Line line2 "Line 2";
  parameter Real zero_H(unit="rad", min=-10, max=10, nominal=0.01) = 0 "Reading of the hip's encoder at angle zero";
  parameter Real zero_K(unit="rad", min=-10, max=10, nominal=0.01) = 0 "Reading of the knee's encoder at angle zero";
  Real encoder_H(unit="rad") "Reading of the hip's encoder";
  Real encoder_K(unit="rad") "Reading of the knee's encoder";
  Real w_H(unit="rad/s") "Speed of the hip";
  Real w_K(unit="rad/s") "Speed of the knee";
equation
  connect(motor1.flange, line1.flange_a);
  connect(line1.flange_b, s1A.flange_a);
  connect(s1A.flange_b, s1B.flange_a);
  connect(s1B.flange_b, shank.flange_a);
  connect(motor2.flange, line2.flange_a);
  connect(line2.flange_b, s2A.flange_a);
  connect(s2A.flange_b, s2B.flange_a);
  connect(s2B.flange_b, crossing.flange_a);
  connect(crossing.flange_b, shank.flange_a);
  connect(s1A.support, pelvis.flange);
  connect(s2A.support, pelvis.flange);
  connect(s1B.support, thigh.flange_a);
  connect(s2B.support, thigh.flange_a);
  connect(crossing.support, thigh.flange_a);
  connect(thigh.support, pelvis.flange);
  connect(shank.support, pelvis.flange);
  connect(thigh.flange_b, joint.support);
  connect(shank.flange_b, joint.link);
  connect(thigh.flange_b, hip.flange_a);
  connect(joint.joint, knee.flange_a);
  connect(outside_H.flange, hip.flange_b);
  connect(outside_K.flange, knee.flange_b);
  q_H = hip.flange_b.phi;
  q_K = knee.flange_b.phi;
  line1.L = s1A.L;
  line2.L = s2A.L;
  encoder_H = q_H - (line1.stretch + line2.stretch) / (2 * t_r) + zero_H;
  encoder_K = q_K - (line1.stretch - line2.stretch) / (2 * t_r) + zero_K;
  w_H = der(q_H);
  w_K = der(q_K);
  C_H = hip.tau;
  C_K = knee.tau;
  annotation(__pycosim(
    estimate="C_H C_K from motor1.phi motor2.phi motor1.tau motor2.tau",
    compensate="motor1.tau motor2.tau from motor1.phi motor2.phi C_H C_K",
    simulate="q_H q_K C_H C_K motor1.phi motor2.phi from tau1 tau2 push_H push_K",
    places="1A=s1A 2A=s2A 1B=s1B 2B=s2B",
    joined="1A+2A 1B+2B motor1+motor2 hip+knee line1+line2",
    load="C_H=hip.computed C_K=knee.computed",
    sensor="C_H=hip.sensed C_K=knee.sensed",
    encoders="q_H=encoder_H:zero_H q_K=encoder_K:zero_K",
    channels="torque=motor1+motor2"));
end HipKneeTransmission;
