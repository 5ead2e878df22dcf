within DriveTrain.Effects;
model ConfigurationPreload "Cable tension that changes with the configuration, as path lengths do"
  extends Interfaces.SegmentEffect(df0=k_H * q_H + k_K * q_K);
  input Real q_H(unit="rad") "Hip angle";
  input Real q_K(unit="rad") "Knee angle";
  parameter Real k_H(unit="N.m/rad", min=-5, max=5, nominal=0.05) = 0 "Loss a radian of hip";
  parameter Real k_K(unit="N.m/rad", min=-5, max=5, nominal=0.05) = 0 "Loss a radian of knee";
  annotation(__pycosim(size="k_H k_K", needs="configurations",
    experiment="cross the workspace along several lines"));
end ConfigurationPreload;
