within DriveTrain.Interfaces;
connector Stretch "Access to a line: its torque and load, and by how much its far end lags behind"
  Real tau(unit="N.m") "True torque at the motor's end";
  Real L(unit="N.m") "Mean load, which keeps the play on one side";
  flow Real dtau(unit="N.m") "Torque lost on the way";
  flow Real dphi(unit="rad") "Angle by which the far end lags behind, in motor units";
end Stretch;
