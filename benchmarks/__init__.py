"""Benchmarks of pycosim, judged from outside the package."""
