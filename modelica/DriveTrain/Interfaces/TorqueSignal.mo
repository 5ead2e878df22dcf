within DriveTrain.Interfaces;
connector TorqueSignal "Access to a torque channel: the truth, and what the channel adds to it"
  Real tau(unit="N.m") "True torque of the current: the shaft's, and what turns the rotor";
  flow Real dtau(unit="N.m") "Added to the measured torque";
end TorqueSignal;
