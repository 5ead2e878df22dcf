within DriveTrain.Examples;
model HipKnee "The leg swings under slow torques of both motors"
  Rigs.HipKnee rig(
    tau1=0.35 * sin(2 * time),
    tau2=0.12 * sin(1.3 * time),
    push_H=0,
    push_K=0) "Rig with its inputs bound";
  annotation(
    experiment(StopTime=4, Interval=0.01),
    __pycosim(simulate="rig.q_H rig.q_K rig.C_H rig.C_K from time"),
    Documentation(info="<html>
<p>Plot rig.q_H and rig.q_K, then rig.C_H against rig.q_H: the loop it encloses is what friction takes from the
motors. rig.s1A.z shows where the proximal stage of line 1 sticks (less than 1 in magnitude).</p>
</html>"));
end HipKnee;
