model Barrier "Road barrier: motor, worm gear, torque sensor, and an arm that a spring half balances"
  input Real torque(unit="N.m") "Torque of the motor";
  input Real push(unit="N.m") "Torque from outside on the arm, as of wind";
  DriveTrain.Components.Motor motor(J=2e-4) "Motor";
  DriveTrain.Components.Segment worm(f0=0.05, mu=0.9) "Worm gear with its losses, in motor units";
  DriveTrain.Components.IdealGear reduction(ratio=40) "Motor units to units of the arm";
  DriveTrain.Components.Fixed post "Post, carries motor, gear and one end of the spring";
  DriveTrain.Components.Sensor sensor "Torque sensor on the axle of the arm";
  DriveTrain.Components.Pendulum arm(m=6, l=1.2) "Arm, hanging at angle zero, upright at pi";
  DriveTrain.Components.Spring spring(c=25, phi_rel0=1.5708) "Balances the arm about the horizontal";
  DriveTrain.Components.Torque outside(tau=push) "Torque from outside on the arm";
  Real q(unit="rad") "Angle of the arm";
  Real C(unit="N.m") "Torque on the arm, as the sensor reads it";
equation
  motor.tau = torque;
  connect(motor.flange, worm.flange_a);
  connect(worm.flange_b, reduction.flange_a);
  connect(worm.support, post.flange);
  connect(reduction.support, post.flange);
  connect(reduction.flange_b, sensor.flange_a);
  connect(sensor.flange_b, arm.flange);
  connect(post.flange, spring.flange_a);
  connect(spring.flange_b, arm.flange);
  connect(arm.flange, outside.flange);
  q = arm.flange.phi;
  C = sensor.tau;
  annotation(__pycosim(
    estimate="C from motor.phi motor.tau",
    compensate="motor.tau from motor.phi push",
    gravity_model="C from motor.phi push",
    simulate="q C motor.phi from torque push"));
end Barrier;
