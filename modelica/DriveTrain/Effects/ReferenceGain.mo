within DriveTrain.Effects;
model ReferenceGain "Wrong scale of the reference: of a torque sensor, or of a whole model of the load"
  extends Interfaces.ReferenceEffect(dgain=g - 1);
  parameter Real g(unit="1", min=0.2, max=5, nominal=0.1) = 1 "Reference over true torque";
  annotation(__pycosim(size="g", needs="loads",
    experiment="hang a known load on the joint at several angles"));
end ReferenceGain;
