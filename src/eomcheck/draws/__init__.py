"""Cases (a scene in a state) drawn at random: by pairwise design, by hostile families, by range.

All draws are functions of a scene and of a source of choices (`eomcheck.mechanics.random_source`):
a NumPy generator, or hypothesis, which can shrink what it chose (`eomcheck.strategies`).
"""
