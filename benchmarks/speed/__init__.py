"""Ratios of time against a named alternative in the same run."""
