within DriveTrain.Examples;
model LinearAxis "A carriage is pushed to and fro"
  Rigs.LinearAxis rig(
    push=60 * sin(4 * time)) "Rig with its inputs bound";
  annotation(
    experiment(StopTime=4, Interval=0.01),
    __pycosim(axis="linear", simulate="rig.x rig.v from time"),
    Documentation(info="<html>
<p>Plot rig.x and rig.v: after each reversal of the force the carriage waits until friction has changed its sign.</p>
</html>"));
end LinearAxis;
