"""Evaluation of a scene and its formulations at one state: in any scalar type, float64, balls."""
