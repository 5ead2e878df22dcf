model OutputLoad "Hip-knee actuation with the load term of each segment on its output torque alone"
  extends DriveTrain.Rigs.HipKnee(
    s1A(load=-s1A.flange_b.tau),
    s2A(load=-s2A.flange_b.tau),
    s1B(load=-s1B.flange_b.tau),
    s2B(load=-s2B.flange_b.tau));
end OutputLoad;
