within DriveTrain.Effects;
model ReferenceZero "Wrong zero of the joint angle that the model of the load is given"
  extends Interfaces.ReferenceEffect(dphi=q0);
  parameter Real q0(unit="rad", min=-3.2, max=3.2, nominal=0.02) = 0 "Angle that the reference takes for zero";
  annotation(__pycosim(size="q0", needs="load_reference configurations", of="load_model",
    experiment="let the joint hang and read its encoder, in two directions"));
end ReferenceZero;
