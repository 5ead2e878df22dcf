within DriveTrain.Effects;
model TorqueRipple "Torque that pulsates with the angle of the rotor: cogging, eccentric gears, commutation"
  extends Interfaces.MotorEffect(dtau=A * sin(n * flange.phi + phase));
  parameter Real A(unit="N.m", min=-5, max=5, nominal=0.01) = 0 "Amplitude";
  parameter Real n(unit="1", min=0.05, max=1000, nominal=1) = 1 "Cycles a revolution";
  parameter Real phase(unit="rad", min=-7, max=7, nominal=1) = 0 "Phase";
  annotation(__pycosim(size="A", scan="n:cycles; phase:quadrature", needs="angles",
    experiment="turn each motor slowly over several revolutions"));
end TorqueRipple;
