within DriveTrain.Components;
model Motor "Motor whose torque is known from its current, tau = k_m Iq"
  Interfaces.Flange flange "Shaft";
  Interfaces.TorqueSignal signal "Port for effects of the torque channel";
  parameter Real J(unit="kg.m2", min=0, max=1, nominal=1e-4) = 0 "Rotor inertia";
  parameter Real zero(unit="rad", min=-1000, max=1000, nominal=0.1) = 0 "Reading of the encoder at angle zero";
  Real phi(unit="rad") "Angle as the encoder reads it";
  Real w(unit="rad/s") "Speed";
  Real a(unit="rad/s2") "Acceleration";
  input Real tau(unit="N.m") "Torque as measured or commanded, k_m Iq";
  Real tau_shaft(unit="N.m") "True torque at the shaft";
equation
  phi = flange.phi + zero;
  w = der(phi);
  a = der(w);
  signal.tau = tau_shaft + J * a;
  tau = signal.tau + signal.dtau;
  flange.tau = -tau_shaft;
  annotation(__pycosim(links="flange: inertia=J"));
end Motor;
