"""Command line in; one verb run, its results in a folder and in sentences, out."""

from .verbs import main

__all__ = ["main"]
