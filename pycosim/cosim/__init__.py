"""A scenario in; its components stepped together, and their log, out."""
