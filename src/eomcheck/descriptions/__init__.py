"""Descriptions of mechanisms by links, joints and constraints, and the scenes made of them.

A description is written in Python (`build.mechanism`, or `described_scene` with parameters of one's
own), read from a URDF or MJCF file, or drawn at random.
"""
