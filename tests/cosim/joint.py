"""A scenario of the geared joint, of which tests replace parts: motion, controller, plant and estimator."""

JOINT = """\
duration = 1.2
seed = 3
connections = [
    "reference -> controller", "plant -> controller", "plant -> estimator", "controller.motor.tau -> plant.tau",
]
[components.reference]
trajectory = "backdrive"
machine = "DriveTrain.Rigs.GearedJoint"
rate = 200
options = { cycle = 1.2, amplitude = 0.1 }
[components.controller]
controller = "position"
machine = "DriveTrain.Rigs.GearedJoint"
rate = 250
parameters = { kp = 1.0, kd = 0.02, ki = 2.0 }
[components.plant]
plant = "DriveTrain.Rigs.GearedJoint"
run = "process"
rate = 500
start = { q = 0.5 }
[components.estimator]
controller = "estimator"
machine = "DriveTrain.Rigs.GearedJoint"
rate = 100
[log]
rate = 100
[log.columns]
theta = { signal = "plant.motor.phi", quantum = 1e-4 }
omega = "plant.motor.w"
tau = { signal = "plant.motor.tau", noise = 1e-3 }
q = "plant.q"
C = "plant.C"
load = "plant.gear.L"
estimate = "estimator.C"
wanted = "reference.ref.q"
"""
