within DriveTrain.Components;
model Line "Path of a cable from its motor to the joint, and the angle that gets lost on it"
  Interfaces.Flange flange_a "Motor";
  Interfaces.Flange flange_b "First stage";
  Interfaces.Stretch line "Port for effects";
  Real tau(unit="N.m") "Torque passed on";
  Real L(unit="N.m") "Mean load of the first stage";
  Real stretch(unit="rad") "Angle by which the joint lags behind, in motor units";
equation
  flange_a.phi = flange_b.phi "Small against the travel: it shows at the joint encoders alone";
  flange_a.tau = tau;
  flange_b.tau = -(tau - line.dtau);
  line.tau = tau;
  line.L = L;
  stretch = line.dphi;
end Line;
