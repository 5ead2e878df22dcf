"""A rig, its limits and what is known in; the next experiment out."""
