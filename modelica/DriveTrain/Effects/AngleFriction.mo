within DriveTrain.Effects;
model AngleFriction "Coulomb friction as a free function of the segment's angle, beside a constant loss f0"
  extends Interfaces.SegmentEffect(dv=(
    c1 * max(0, 2 - abs(u + 1))^3 + c2 * max(0, 2 - abs(u))^3 + c3 * max(0, 2 - abs(u - 1))^3
    + c4 * max(0, 2 - abs(u - 3))^3 + c5 * max(0, 2 - abs(u - 4))^3 + c6 * max(0, 2 - abs(u - 5))^3
    - 4 * (c2 * max(0, 1 - abs(u))^3 + c3 * max(0, 1 - abs(u - 1))^3 + c4 * max(0, 1 - abs(u - 3))^3
    + c5 * max(0, 1 - abs(u - 4))^3)) / 6);
  parameter Real c1(unit="N.m", min=-1000, max=1000, nominal=0.05) = 0 "Friction a quarter below low, beyond midway";
  parameter Real c2(unit="N.m", min=-1000, max=1000, nominal=0.05) = 0 "Friction about low, beyond midway";
  parameter Real c3(unit="N.m", min=-1000, max=1000, nominal=0.05) = 0 "Friction about 1/4 of travel, beyond midway";
  parameter Real c4(unit="N.m", min=-1000, max=1000, nominal=0.05) = 0 "Friction about 3/4 of travel, beyond midway";
  parameter Real c5(unit="N.m", min=-1000, max=1000, nominal=0.05) = 0 "Friction about high, beyond midway";
  parameter Real c6(unit="N.m", min=-1000, max=1000, nominal=0.05) = 0 "Friction a quarter above high, beyond midway";
  parameter Real low(unit="rad", min=-1e5, max=1e5, nominal=1) = -1 "Least angle of the function, that of the log";
  parameter Real high(unit="rad", min=-1e5, max=1e5, nominal=1) = 1 "Greatest angle; it is constant beyond both";
protected
  Real u(unit="1") "Angle on the scale of the splines, 0 at low and 4 at high";
equation
  u = 4 * max(0, min(1, (friction.phi - low) / max(1e-9, high - low)));
  annotation(__pycosim(size="c1 c2 c3 c4 c5 c6", means="low:min(friction.phi); high:max(friction.phi)",
    by_name="it is a free function, which imitates preload and wear of any kind, and names no cause",
    needs="configurations", experiment="cross the workspace slowly along several lines, both ways"));
end AngleFriction;
