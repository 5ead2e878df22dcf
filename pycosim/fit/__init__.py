"""Samples and a model in; parameters, intervals, and what the data do not determine, out."""
