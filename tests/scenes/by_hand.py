"""What scenes gave whose equations were written by hand, before descriptions took their place.

Exactly, as residues modulo a prime: doubles are rational numbers, a cosine and a sine are those of
the point t = 7 x of the circle for the number x of the angle, and 5 x + 13 stands for a root.
`by_hand.json` holds digests. `python -m tests.scenes.by_hand KEY ...` prints those of the scenes as
they are now.
"""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import flint
import numpy as np
from tests.samples import random_scene

from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Angles, Array
from eomcheck.scenes import SCENES

PRIME = 2**61 - 1
STORED = Path(__file__).with_suffix(".json")
MORE = {"four-bar-chain": {"repeated": 2.5}, "bricard": {"redundant": 2.5}}
"""Key -> parameters of one more scene, that are absent otherwise."""
TERMS = "M", "Q", "B", "a", "gamma", "b"


def residue(x: Any) -> flint.nmod:
    """Return a double as a residue."""
    above, below = float(x).as_integer_ratio()
    return flint.nmod(above, PRIME) / below


class Residues:
    """Numbers modulo one prime, the same at every run."""

    def numbers(self, x: Any) -> Array:
        given = np.asarray(x)
        if given.dtype == object:
            return given
        return np.array([residue(one) for one in given.flat], object).reshape(given.shape)

    def angles(self, x: Any) -> Angles:
        value = self.numbers(x)
        t = 7 * value
        return Angles(value, (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t))

    def root(self, x: Any) -> Array:
        return 5 * self.numbers(x) + 13

    def literal(self, x: int) -> flint.nmod:
        return flint.nmod(x, PRIME)


def digest(x: Any) -> str:
    if x is None:
        return "absent"
    entries = [int(one) % PRIME for one in np.ravel(np.asarray(x, object))]
    return hashlib.sha256(repr((np.shape(x), entries)).encode()).hexdigest()[:16]


def given_by(scene: Scene) -> dict[str, str]:
    """Return a digest of each quantity of a scene at one point."""
    residues: Any = Residues()
    q = residues.numbers(np.arange(2.0, 2.0 + scene.n) ** 3)
    v = residues.numbers(np.arange(3.0, 3.0 + scene.n) ** 2)
    at = Quantities(scene, residues, q, residues.numbers([0.75])[0])
    at.v = v
    found = dict(zip(TERMS, at.terms, strict=True))
    here = at.parameters, at.prepared, q
    found["T"], found["U"] = scene.energies(*here, v)
    found["c"] = scene.constraint(*here, v)
    if scene.dissipation is not None:
        found["R"] = scene.dissipation(*here, v)
    if scene.position_residual is not None:
        found["positions"] = scene.position_residual(*here)
    return {name: digest(x) for name, x in found.items()}


def looked_at(key: str) -> dict[str, Scene]:
    """Return scenes of a kind by name: random ones, and one of each structure."""
    kind = SCENES[key]
    found = {}
    for seed in range(3):
        found[f"random {seed}"] = random_scene(kind, np.random.default_rng(seed))
    for scene in kind.structures(3 if kind.has_links else None):
        found[scene.structure] = scene
    if key in MORE:
        found["more"] = replace(kind.example(), **MORE[key])
    return found


def of_scenes(keys: list[str]) -> dict[str, dict[str, dict[str, str]]]:
    return {key: {name: given_by(scene) for name, scene in looked_at(key).items()} for key in keys}


if __name__ == "__main__":
    print(json.dumps(of_scenes(sys.argv[1:]), indent=1, ensure_ascii=False))
