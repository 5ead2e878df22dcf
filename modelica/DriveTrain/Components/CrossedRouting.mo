within DriveTrain.Components;
model CrossedRouting "Crossed cable about a link: reverses the motion relative to it"
  extends IdealGear(ratio=-1);
end CrossedRouting;
