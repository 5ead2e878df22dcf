within DriveTrain.Effects;
model MotorAngleTorque "Torque as a free function of the rotor's angle, taken from the shaft"
  extends Interfaces.MotorEffect(loss=(
    c1 * max(0, 2 - abs(u + 1))^3 + c2 * max(0, 2 - abs(u))^3 + c3 * max(0, 2 - abs(u - 1))^3
    + c4 * max(0, 2 - abs(u - 2))^3 + c5 * max(0, 2 - abs(u - 3))^3 + c6 * max(0, 2 - abs(u - 4))^3
    + c7 * max(0, 2 - abs(u - 5))^3 + c8 * max(0, 2 - abs(u - 6))^3 + c9 * max(0, 2 - abs(u - 7))^3
    + c10 * max(0, 2 - abs(u - 8))^3
    - 4 * (c2 * max(0, 1 - abs(u))^3 + c3 * max(0, 1 - abs(u - 1))^3 + c4 * max(0, 1 - abs(u - 2))^3
    + c5 * max(0, 1 - abs(u - 3))^3 + c6 * max(0, 1 - abs(u - 4))^3 + c7 * max(0, 1 - abs(u - 5))^3
    + c8 * max(0, 1 - abs(u - 6))^3 + c9 * max(0, 1 - abs(u - 7))^3)) / 6);
  parameter Real c1(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about a seventh of the travel below low";
  parameter Real c2(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about low";
  parameter Real c3(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about 1/7 of the travel";
  parameter Real c4(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about 2/7 of the travel";
  parameter Real c5(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about 3/7 of the travel";
  parameter Real c6(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about 4/7 of the travel";
  parameter Real c7(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about 5/7 of the travel";
  parameter Real c8(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about 6/7 of the travel";
  parameter Real c9(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about high";
  parameter Real c10(unit="N.m", min=-1000, max=1000, nominal=1) = 0 "Torque about a seventh of the travel above high";
  parameter Real low(unit="rad", min=-1e5, max=1e5, nominal=1) = -1 "Least angle of the function, that of the log";
  parameter Real high(unit="rad", min=-1e5, max=1e5, nominal=1) = 1 "Greatest angle; it is constant beyond both";
protected
  Real u(unit="1") "Angle on the scale of the splines, 0 at low and 7 at high";
equation
  u = 7 * max(0, min(1, (flange.phi - low) / max(1e-9, high - low)));
  annotation(__pycosim(size="c1 c2 c3 c4 c5 c6 c7 c8 c9 c10", means="low:min(flange.phi); high:max(flange.phi)",
    by_name="it is a free function, which imitates springs, errors of gravity and preload, and names no cause",
    needs="angles", experiment="cross the whole travel slowly, both ways"));
end MotorAngleTorque;
