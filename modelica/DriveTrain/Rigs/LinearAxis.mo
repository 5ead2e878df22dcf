within DriveTrain.Rigs;
model LinearAxis "Drive that pushes a carriage along its guide, everything along the axis"
  input Real push(unit="N") "Force of the drive on the carriage";
  Components.Motor motor(tau=push) "Drive, its torque is a force here";
  Components.Segment guide(f0(min=0, max=1e5, nominal=10)=20, mu=1, travel=1e-5) "Guide and screw, no load term";
  Effects.Viscous viscous_guide(b(min=0, max=1e5, nominal=100)=200) "Viscous friction of guide and screw";
  Components.Fixed frame "Frame, carries the guide";
  Components.Inertia carriage(J(min=0, max=1e5, nominal=10)=100) "Mass of the carriage and of what turns with it";
  Real force(unit="N") "Force that the motion asks for";
  Real x(unit="m") "Position of the carriage";
  Real v(unit="m/s") "Speed of the carriage";
equation
  connect(motor.flange, guide.flange_a);
  connect(guide.flange_b, carriage.flange);
  connect(guide.support, frame.flange);
  connect(viscous_guide.friction, guide.friction);
  force = motor.tau;
  x = motor.phi;
  v = motor.w;
  annotation(__pycosim(
    axis="linear",
    estimate="force from motor.phi",
    compensate="force from motor.phi",
    simulate="motor.phi motor.w from push",
    channels="force=motor"),
    Documentation(info="<html>
<p>The equations of a drive train hold for a linear axis word for word: an angle is a position [m], a torque a force
[N], an inertia a mass [kg]. The annotation axis=\"linear\" has every unit read so.</p>
</html>"));
end LinearAxis;
