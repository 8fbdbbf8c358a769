"""Kinds of numbers: the functions of scenes and formulations run unchanged in each of them."""
