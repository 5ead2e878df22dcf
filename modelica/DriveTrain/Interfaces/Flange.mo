within DriveTrain.Interfaces;
connector Flange "One-dimensional rotational flange (a shaft end)"
  Real phi(unit="rad") "Absolute rotation angle of the flange";
  flow Real tau(unit="N.m") "Cut torque, positive into the component";
end Flange;
