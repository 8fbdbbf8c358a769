"""Motions: compiled right-hand sides, integrators, trajectories, and reference solutions."""
