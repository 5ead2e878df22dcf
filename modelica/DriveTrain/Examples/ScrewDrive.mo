within DriveTrain.Examples;
model ScrewDrive "A lead screw is driven to and fro"
  Rigs.ScrewDrive rig(
    tau_in=6e-3 * sin(4 * time)) "Rig with its inputs bound";
  annotation(
    experiment(StopTime=4, Interval=0.01),
    __pycosim(simulate="rig.motor.phi rig.motor.w rig.nut.v from time"),
    Documentation(info="<html>
<p>Plot rig.tau against rig.motor.w: two lines, one a direction, whose distance at standstill is twice rig.screw.f0
and whose slope is rig.viscous_screw.b. Then plot rig.nut.v.</p>
</html>"));
end ScrewDrive;
