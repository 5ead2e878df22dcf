within DriveTrain.Interfaces;
connector JointTorque "Access to a joint: its angle, and the torques that it takes beside its load"
  Real phi(unit="rad") "Angle of the joint";
  flow Real dtau(unit="N.m") "Torque taken beside the load";
end JointTorque;
