"""A study file in; checked settings out, and back into a file."""
