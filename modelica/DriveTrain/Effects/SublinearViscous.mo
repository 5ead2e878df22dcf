within DriveTrain.Effects;
model SublinearViscous "Friction that grows less than the speed does, as of greases that thin when sheared"
  extends Interfaces.SegmentEffect(dv=b * max(1e-9, abs(friction.w))^a);
  parameter Real b(unit="N.m", min=0, max=10, nominal=0.01) = 0 "Friction at a speed of one rad/s";
  parameter Real a(unit="1", min=0.05, max=1, nominal=0.3) = 0.5 "Power of the speed";
  annotation(__pycosim(size="b", scan="a:power", refines="viscous", needs="speeds",
    experiment="repeat the passes at five or more speeds, over two decades"));
end SublinearViscous;
