within DriveTrain.Examples;
model HipKneeTransmission "Transmission without a leg, held back by torques on its joints"
  Rigs.HipKneeTransmission rig(
    motor1(J=2e-3),
    motor2(J=2e-3),
    tau1=0.6 * sin(3 * time),
    tau2=0.4 * sin(2 * time),
    push_H=-4 * rig.w_H - 20 * rig.q_H,
    push_K=-4 * rig.w_K - 20 * rig.q_K) "Rig with its inputs bound";
  annotation(
    experiment(StopTime=4, Interval=0.01),
    __pycosim(simulate="rig.q_H rig.q_K rig.C_H rig.C_K from time"),
    Documentation(info="<html>
<p>The joints carry springs and dampers instead of a leg, and the rotors have the inertia that makes the motion
determined. Plot rig.C_H and rig.C_K with -rig.push_H and -rig.push_K: they agree, since nothing else loads the
joints. Then plot the losses rig.s1A.loss, rig.s2A.loss, rig.s1B.loss, rig.s2B.loss.</p>
</html>"));
end HipKneeTransmission;
