"""Questions of a model in; motion, states and signals over time out."""
