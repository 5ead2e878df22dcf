within DriveTrain.Rigs;
model ServoPendulum "Servo fed by a voltage that lifts a pendulum, everything at the output shaft"
  input Real v_in(unit="V") "Voltage at the motor's terminals";
  Components.DCMotor motor(v=v_in) "Motor with its gear train, at the output";
  Components.Segment gear(f0=0.045, mu=1) "Gear train, without a load term";
  Effects.Viscous viscous_gear(b=0.0045) "Viscous friction of the gear train";
  Components.Fixed housing "Housing of the servo";
  Components.Pendulum pendulum "Mass on an arm";
  Real voltage(unit="V") "Voltage that the motion asks for";
  Real q(unit="rad") "Angle of the pendulum, hanging at zero";
equation
  connect(motor.flange, gear.flange_a);
  connect(gear.flange_b, pendulum.flange);
  connect(gear.support, housing.flange);
  connect(viscous_gear.friction, gear.friction);
  voltage = motor.v;
  q = pendulum.flange.phi;
  annotation(__pycosim(
    estimate="voltage from motor.phi",
    compensate="voltage from motor.phi",
    simulate="motor.phi motor.w from v_in"));
end ServoPendulum;
