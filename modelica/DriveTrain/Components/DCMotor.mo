within DriveTrain.Components;
model DCMotor "DC motor fed by a voltage, everything at its output shaft, inductance neglected"
  Interfaces.Flange flange "Shaft";
  Interfaces.TorqueSignal signal "Port for effects of the torque channel";
  parameter Real R(unit="Ohm", min=0.1, max=50, nominal=1) = 4.4 "Resistance of the winding";
  parameter Real k_t(unit="N.m/A", min=1e-4, max=10, nominal=0.1) = 0.37 "Torque constant, also back-EMF constant";
  parameter Real J(unit="kg.m2", min=0, max=1, nominal=1e-3) = 2e-3 "Rotor inertia";
  input Real v(unit="V") "Voltage at the terminals";
  parameter Real zero(unit="rad", min=-1000, max=1000, nominal=0.1) = 0 "Reading of the encoder at angle zero";
  Real phi(unit="rad") "Angle as the encoder reads it";
  Real w(unit="rad/s") "Speed";
  Real a(unit="rad/s2") "Acceleration";
  Real i(unit="A") "Current";
  Real tau(unit="N.m") "Torque of the current";
  Real tau_shaft(unit="N.m") "True torque at the shaft";
equation
  phi = flange.phi + zero;
  w = der(phi);
  a = der(w);
  v = R * i + k_t * w;
  tau = k_t * i;
  signal.tau = tau_shaft + J * a;
  tau = signal.tau + signal.dtau;
  flange.tau = -tau_shaft;
  annotation(__pycosim(links="flange: inertia=J"));
end DCMotor;
