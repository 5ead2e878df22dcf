within DriveTrain.Components;
model Pendulum "Point mass on an arm in the vertical plane, hanging at angle zero"
  Interfaces.Flange flange "Axle";
  parameter Real m(unit="kg", min=0, max=50, nominal=0.1) = 0.49 "Point mass";
  parameter Real l(unit="m", min=0, max=2, nominal=0.1) = 0.10 "Axle to point mass";
  parameter Real arm(unit="kg.m", min=0, max=10, nominal=0.01) = 0 "Mass of the arm times its centre's distance";
  parameter Real J(unit="kg.m2", min=0, max=10, nominal=1e-3) = 0 "Inertia of the arm about the axle";
  parameter Real g(unit="m/s2") = 9.80665 "Gravity";
  parameter Real tilt(unit="rad", min=-3.2, max=3.2, nominal=0.1) = 0 "Tilt of the base from the vertical";
  Real w(unit="rad/s") "Speed";
  Real a(unit="rad/s2") "Acceleration";
equation
  w = der(flange.phi);
  a = der(w);
  (m * l * l + J) * a + (m * l + arm) * g * sin(flange.phi + tilt) = flange.tau;
  annotation(__pycosim(gravity="g", tilt="tilt", links="flange: mass=m, moment=m*l+arm, inertia=m*l*l+J"));
end Pendulum;
