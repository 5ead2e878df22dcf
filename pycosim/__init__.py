"""Compare the model of a geared or cable-driven actuator with its measurements, and learn which effect is missing."""

__version__ = "0.1.0"
