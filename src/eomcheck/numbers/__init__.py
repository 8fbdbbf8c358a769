"""Scalar types, on each of which the generic functions of scenes and formulations run unchanged."""
