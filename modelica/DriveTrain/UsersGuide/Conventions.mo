within DriveTrain.UsersGuide;
class Conventions "Units, signs and names"
  annotation(Documentation(info="<html>
<h4>Units</h4>
<p>SI throughout: rad, rad/s, N.m, s, kg, V. Every parameter and variable carries its unit. A transmission is written in
motor units; an ideal gear at its end converts to joint units.</p>
<h4>Signs</h4>
<ul>
<li>A flow variable (tau, f) is positive into the component, as in the Modelica Standard Library: a torque tau on a
flange accelerates what is behind it. A motor therefore says flange.tau = -tau_shaft.</li>
<li>A motor torque is positive along the motor's angle.</li>
<li>C, the torque of a transmission on its joint, is positive when it drives the joint along its angle.
Hip flexion and knee extension are positive; the thigh angle counts from the vertical.</li>
<li>push, a torque from outside on a joint, is positive along the joint's angle.</li>
</ul>
<h4>Segments</h4>
<ul>
<li>w is the speed relative to the support, s its sign when sliding; s and z lie between -1 and 1 while sticking.</li>
<li>tau_in = flange_a.tau enters, tau_out = -flange_b.tau leaves; tau_out = tau_in - s F.</li>
<li>L = (tau_in + tau_out) / 2 is the mean load, F = 2 mu f0 / (1 + mu) + 2 (1 - mu) / (1 + mu) |L| the friction
torque, never negative [Nobili, Salsedo, Filippeschi, Eq. (friction_model)].</li>
<li>Direct: L w &gt; 0, power flows from flange_a to flange_b. Reverse: L w &lt; 0. The branch changes where L = 0, and
the law is continuous there.</li>
<li>The support takes the difference, flange_a.tau + flange_b.tau + support.tau = 0. Standing on a moving link, its
reaction is what makes joint torques come out of the connections.</li>
<li>Sticking: travel z' = w - (|w| slip + w |slip|) / 2, where slip rises from 0 at |z| = elastic to the sign of z at
|z| = 1 [Dupont et al., 2002]. A segment at rest under load moves by at most about its travel, elastically, and does not
creep; for travel to 0 its z is the sign of w. s is z, damped while z changes, and within -1 and 1.</li>
</ul>
<h4>Effects</h4>
<p>An effect adds to a segment's law, or to a motor's torque, through one port, and adds nothing at its neutral
coefficients. What a motor effect adds belongs to the measured torque: measured = true + addition.</p>
</html>"));
end Conventions;
