within DriveTrain.Effects;
model RotorInertia "Torque that accelerates the rotor"
  extends Interfaces.MotorEffect(loss=J * a);
  parameter Real J(unit="kg.m2", min=0, max=1, nominal=1e-4) = 0 "Moment of inertia";
  Real w(unit="rad/s") "Speed";
  Real a(unit="rad/s2") "Acceleration";
equation
  w = der(flange.phi);
  a = der(w);
  annotation(__pycosim(size="J", needs="accelerations",
    experiment="accelerate hard, and cruise, over the same line", links="flange: inertia=J"));
end RotorInertia;
