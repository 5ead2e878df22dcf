"""Logs that break the assumptions of the package's own generators on purpose, and what the diagnosis says of them."""
