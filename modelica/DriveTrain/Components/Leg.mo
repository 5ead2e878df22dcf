within DriveTrain.Components;
model Leg "Thigh and shank in a vertical plane, hip fixed in space"
  Interfaces.Flange hip "Hip flexion, thigh angle from the vertical";
  Interfaces.Flange knee "Knee extension, shank angle is hip + knee";
  parameter Real m1(unit="kg", min=0, max=50, nominal=1) = 4.0 "Mass of the thigh";
  parameter Real c1(unit="m", min=0, max=2, nominal=0.1) = 0.20 "Hip to centre of mass of the thigh";
  parameter Real l1(unit="m", min=0, max=2, nominal=0.1) = 0.42 "Length of the thigh";
  parameter Real I1(unit="kg.m2", min=0, max=10, nominal=0.1) = 0.06 "Inertia of the thigh about its centre of mass";
  parameter Real m2(unit="kg", min=0, max=50, nominal=1) = 3.2 "Mass of the shank";
  parameter Real c2(unit="m", min=0, max=2, nominal=0.1) = 0.15 "Knee to centre of mass of the shank";
  parameter Real I2(unit="kg.m2", min=0, max=10, nominal=0.1) = 0.03 "Inertia of the shank about its centre of mass";
  parameter Real g(unit="m/s2") = 9.80665 "Gravity";
  parameter Real tilt(unit="rad", min=-3.2, max=3.2, nominal=0.1) = 0 "Tilt of the base from the vertical";
  Real w_H(unit="rad/s") "Speed of the hip";
  Real w_K(unit="rad/s") "Speed of the knee";
  Real a_H(unit="rad/s2") "Acceleration of the hip";
  Real a_K(unit="rad/s2") "Acceleration of the knee";
protected
  Real shank(unit="rad") "Absolute angle of the shank";
  Real w2(unit="rad/s") "Absolute speed of the shank";
  Real a2(unit="rad/s2") "Absolute acceleration of the shank";
  Real h(unit="kg.m2") "Coupling inertia";
  Real torque_thigh(unit="N.m") "Torque on the absolute angle of the thigh";
  Real torque_shank(unit="N.m") "Torque on the absolute angle of the shank";
equation
  w_H = der(hip.phi);
  w_K = der(knee.phi);
  a_H = der(w_H);
  a_K = der(w_K);
  shank = hip.phi + knee.phi;
  w2 = w_H + w_K;
  a2 = a_H + a_K;
  h = m2 * l1 * c2;
  torque_thigh = (I1 + m1 * c1 * c1 + m2 * l1 * l1) * a_H + h * cos(hip.phi - shank) * a2
    + h * sin(hip.phi - shank) * w2 * w2
    + (m1 * c1 + m2 * l1) * g * sin(hip.phi + tilt);
  torque_shank = (I2 + m2 * c2 * c2) * a2 + h * cos(hip.phi - shank) * a_H
    - h * sin(hip.phi - shank) * w_H * w_H + m2 * c2 * g * sin(shank + tilt);
  hip.tau = torque_thigh + torque_shank;
  knee.tau = torque_shank;
  annotation(__pycosim(gravity="g", tilt="tilt",
    links="hip: mass=m1, moment=m1*c1, inertia=I1+m1*c1*c1, length=l1;
    knee on hip: mass=m2, moment=m2*c2, inertia=I2+m2*c2*c2"));
end Leg;
