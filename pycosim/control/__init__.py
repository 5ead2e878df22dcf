"""A machine's model in; controllers, an estimator and motions out."""
