within DriveTrain.Effects;
model ReferenceOffset "Constant error of the reference"
  extends Interfaces.ReferenceEffect(dC=o);
  parameter Real o(unit="N.m", min=-100, max=100, nominal=0.1) = 0 "Offset";
  annotation(__pycosim(size="o", needs="directions",
    experiment="read the reference where the load has no torque"));
end ReferenceOffset;
