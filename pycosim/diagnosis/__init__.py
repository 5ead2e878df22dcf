"""A fitted model and its data in; which effect is missing, where, how sure, out."""
