within DriveTrain.Examples;
model ServoPendulum "A servo swings a pendulum under a sinusoidal voltage"
  Rigs.ServoPendulum rig(
    v_in=4 * sin(3 * time)) "Rig with its inputs bound";
  annotation(
    experiment(StopTime=4, Interval=0.01),
    __pycosim(simulate="rig.motor.phi rig.motor.w from time"),
    Documentation(info="<html>
<p>Plot rig.motor.phi with rig.voltage: after each reversal of the voltage the pendulum waits until rig.gear.z has
crossed from one sign to the other.</p>
</html>"));
end ServoPendulum;
