package DriveTrain "Geared and cable-driven actuators: segments with load-dependent friction, effects, rigs"
end DriveTrain;
