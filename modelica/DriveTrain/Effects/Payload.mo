within DriveTrain.Effects;
model Payload "Mass that the model of the load does not know"
  extends Interfaces.PointEffect(weight=9.80665 * m);
  parameter Real m(unit="kg", min=-10, max=50, nominal=0.1) = 0 "Mass; negative where the model has too much";
  annotation(__pycosim(size="m", needs="load_reference configurations",
    experiment="hold the joint at several angles, with and without a known payload"));
end Payload;
