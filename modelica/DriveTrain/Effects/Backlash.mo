within DriveTrain.Effects;
model Backlash "Play that lies on the side that the load pushes it to"
  extends Interfaces.LineEffect(stretch=gap / 2 * sign(line.L));
  parameter Real gap(unit="rad", min=0, max=3, nominal=1e-3) = 0 "Whole play, in motor units";
  annotation(__pycosim(size="gap", needs="joint_encoders load_signs",
    experiment="log the joint encoders, and pass postures where the load changes its sign"));
end Backlash;
