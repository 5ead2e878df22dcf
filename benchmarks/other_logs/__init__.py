"""Logs of the hip-knee machine from a second generator, written apart from the package and from `real_logs`."""
