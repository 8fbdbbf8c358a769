"""Scenes: their base class, the records of their equations, parameters, sketches and bodies."""
