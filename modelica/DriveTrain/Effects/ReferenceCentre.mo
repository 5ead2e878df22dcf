within DriveTrain.Effects;
model ReferenceCentre "Wrong centre of mass in the model of the load that a reference is computed with"
  extends Interfaces.LinkCentreEffect(error=c);
  parameter Real c(unit="m", min=-1, max=2, nominal=0.01) = 0 "How much farther out the reference has it";
  annotation(__pycosim(size="c", needs="load_reference configurations", of="load_model",
    experiment="balance the link on an edge, or compare with a torque sensor at several angles"));
end ReferenceCentre;
