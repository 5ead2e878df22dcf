within DriveTrain.Examples;
model GearedJoint "A geared joint lifts and lowers a pendulum"
  Rigs.GearedJoint rig(
    tau=0.2 * sin(1.5 * time),
    push=0) "Rig with its inputs bound";
  annotation(
    experiment(StopTime=4, Interval=0.01),
    __pycosim(simulate="rig.q rig.C rig.motor.phi from time"),
    Documentation(info="<html>
<p>Plot rig.C / rig.reduction.ratio and rig.tau against rig.q: the torque that leaves the gear lies below the
motor's when it lifts, above it when the load drives the motor back.</p>
</html>"));
end GearedJoint;
