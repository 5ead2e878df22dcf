within DriveTrain.Rigs;
model ScrewDrive "Motor that drives a lead screw, speed and torque measured"
  input Real tau_in(unit="N.m") "Torque of the motor";
  Components.Motor motor(tau=tau_in, J=1e-6) "Motor";
  Components.Segment screw(f0=3e-3, mu=1) "Contact of screw and nut, without a load term";
  Effects.Viscous viscous_screw(b=5e-5) "Viscous friction of the screw";
  Components.Fixed frame "Frame";
  Components.Screw nut "Kinematics and mass of the nut";
  Real tau(unit="N.m") "Torque that the motion asks for";
equation
  connect(motor.flange, screw.flange_a);
  connect(screw.flange_b, nut.flange);
  connect(screw.support, frame.flange);
  connect(viscous_screw.friction, screw.friction);
  tau = motor.tau;
  annotation(__pycosim(
    estimate="tau from motor.w",
    compensate="tau from motor.w",
    simulate="motor.phi motor.w nut.v from tau_in"));
end ScrewDrive;
