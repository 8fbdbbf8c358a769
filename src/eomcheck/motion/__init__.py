"""Simulation of motions: compiled right-hand sides, integrators, trajectories and references."""
