"""Scalar types: the generic functions of scenes and formulations run unchanged on each of them."""
