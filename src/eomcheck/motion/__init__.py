"""Motion: compiled right-hand sides of the formulations, and reference solutions."""
