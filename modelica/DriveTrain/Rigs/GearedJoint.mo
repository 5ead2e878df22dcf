within DriveTrain.Rigs;
model GearedJoint "Motor, gear with load-dependent losses, and a joint that moves a pendulum"
  input Real tau(unit="N.m") "Torque of the motor, k_m Iq";
  input Real push(unit="N.m") "Torque from outside on the joint";
  Components.Motor motor(J=1e-4) "Motor";
  Components.Segment gear "Gear with its losses, in motor units";
  Components.IdealGear reduction(ratio=50) "Motor units to joint units";
  Components.Fixed frame "Frame, carries motor and gear";
  Components.Joint joint "Joint; its load hangs on flange_b";
  Components.Pendulum load(m=4, l=0.3, J=0.05) "Link and what it carries";
  Components.HangingLink link_model(m=load.m, c=load.l, arm=load.arm, tilt=load.tilt) "Link that a reference knows";
  Components.Torque outside(tau=push) "Torque from outside on the joint";
  Real q(unit="rad") "Angle of the joint";
  Real w(unit="rad/s") "Speed of the joint";
  Real C(unit="N.m") "Torque of the transmission on the joint";
equation
  motor.tau = tau "An equation: pymoca resolves the modifier tau=tau wrongly";
  connect(motor.flange, gear.flange_a);
  connect(gear.flange_b, reduction.flange_a);
  connect(gear.support, frame.flange);
  connect(reduction.support, frame.flange);
  connect(reduction.flange_b, joint.flange_a);
  connect(joint.flange_b, load.flange);
  connect(joint.flange_b, outside.flange);
  connect(link_model.joint, joint.reference);
  q = joint.flange_b.phi;
  w = der(q);
  C = joint.tau;
  annotation(__pycosim(
    estimate="C from motor.phi motor.tau; motor.tau from motor.phi push",
    compensate="motor.tau from motor.phi C",
    gravity_model="C from motor.phi push",
    balance="push from motor.phi motor.tau",
    simulate="q C motor.phi from tau push",
    load="C=joint.computed",
    sensor="C=joint.sensed",
    places="link=link_model",
    channels="torque=motor"));
end GearedJoint;
