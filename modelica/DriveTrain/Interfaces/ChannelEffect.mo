within DriveTrain.Interfaces;
partial model ChannelEffect "Shifts a recorded torque in time; no part of the equations of motion"
  TorqueSignal signal "Torque channel, to which nothing is added";
  Real delay(unit="s") = 0 "Time by which the record comes after the truth";
  Real lag(unit="s") = 0 "Time constant of a first-order lag of the record";
equation
  signal.dtau = 0;
  annotation(__pycosim(place="channels"));
end ChannelEffect;
