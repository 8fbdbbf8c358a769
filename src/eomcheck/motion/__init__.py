"""Motion: right-hand sides of the formulations in machine code, and reference solutions."""
