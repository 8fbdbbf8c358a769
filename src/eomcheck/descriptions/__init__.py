"""Declarative descriptions of mechanisms by links, joints and constraints, and their scenes.

A description is written in Python (`build.mechanism`, or `described_scene` with user-defined
parameters), read from a URDF, MJCF or SDF file, or sampled at random.
"""
