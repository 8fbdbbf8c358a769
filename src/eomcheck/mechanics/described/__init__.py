"""Mechanisms as descriptions: a tree of rigid bodies in space, and what closes or drives it."""
