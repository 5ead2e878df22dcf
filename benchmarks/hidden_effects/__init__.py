"""Hidden effects: an independent machine whose logs the diagnosis has to explain."""
