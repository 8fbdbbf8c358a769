"""Studies: they measure and return Records."""
