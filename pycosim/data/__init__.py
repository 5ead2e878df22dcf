"""Logs in; checked samples, arranged for fitting, out."""
