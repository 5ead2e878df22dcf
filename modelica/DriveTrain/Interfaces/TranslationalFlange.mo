within DriveTrain.Interfaces;
connector TranslationalFlange "One-dimensional translational flange (a rod end)"
  Real s(unit="m") "Absolute position of the flange";
  flow Real f(unit="N") "Cut force, positive into the component";
end TranslationalFlange;
