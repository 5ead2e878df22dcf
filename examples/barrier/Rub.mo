model Rub "Friction that rises at one angle of the arm, as where something rubs"
  extends DriveTrain.Interfaces.SegmentEffect(dF=A * exp(-((q - at) / width)^2));
  input Real q(unit="rad") "Angle of the arm";
  parameter Real A(unit="N.m", min=0, max=1, nominal=0.05) = 0 "Friction where it rubs most";
  parameter Real at(unit="rad", min=0, max=3, nominal=1) = 1.4 "Angle where it rubs most";
  parameter Real width(unit="rad", min=0.01, max=1, nominal=0.1) = 0.1 "How far from there it rubs still";
  annotation(__pycosim(size="A", scan="at:angle; width:angle", experiment="pass the whole range slowly"));
end Rub;
