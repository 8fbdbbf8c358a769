"""Evaluation of a scene and its formulations at one state, in float64 or any other scalar type."""
