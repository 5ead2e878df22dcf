"""Measured data made by others, read beside the project."""
