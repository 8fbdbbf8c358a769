"""Studies: what is measured, kept, shown and reported."""
