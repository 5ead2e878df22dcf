within DriveTrain.Effects;
model ReferenceMass "Wrong mass in the model of the load that a reference is computed with"
  extends Interfaces.LinkMassEffect(error=m);
  parameter Real m(unit="kg", min=-20, max=50, nominal=0.1) = 0 "Mass that the reference has too much";
  annotation(__pycosim(size="m", needs="load_reference configurations", of="load_model",
    experiment="weigh the link, or compare with a torque sensor at several angles"));
end ReferenceMass;
