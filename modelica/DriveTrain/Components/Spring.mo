within DriveTrain.Components;
model Spring "Linear rotational spring"
  Interfaces.Flange flange_a "One end";
  Interfaces.Flange flange_b "Other end";
  parameter Real c(unit="N.m/rad", min=0, max=1e6, nominal=1) = 1 "Stiffness";
  parameter Real phi_rel0(unit="rad", min=-10, max=10, nominal=0.1) = 0 "Angle without load";
equation
  flange_b.tau = c * (flange_b.phi - flange_a.phi - phi_rel0);
  flange_a.tau + flange_b.tau = 0;
end Spring;
