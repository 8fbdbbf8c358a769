"""What pictures of the scenes are made of, in one pose each, number by number.

`sketches.json` holds them. `python -m tests.scenes.sketches` writes it again, to be looked at: a
part that has moved is seen by who reads the change.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from tests.samples import random_scene

from eomcheck.scenes import SCENES

STORED = Path(__file__).with_suffix(".json")


def written(part: Any) -> str:
    """The kind of a part and its fields, with numbers to a micrometre."""
    fields = (f"{name} {_said(x)}" for name, x in part._asdict().items() if _said(x))
    return f"{type(part).__name__}: {', '.join(fields)}"


def _said(x: Any) -> str:
    if x is None or isinstance(x, str | bool):
        return str(x) if x else ""
    rounded = np.round(np.asarray(x, float), 6) + 0.0
    return json.dumps(rounded.tolist())


def sketched(key: str) -> list[str]:
    """All parts of a scene whose parameters are drawn, in a pose without symmetry, and its view."""
    kind: Any = SCENES[key]
    scene = random_scene(kind, np.random.default_rng(5), 3 if kind.has_links else None)
    q = scene.initial_state()[0] + 0.1 + 0.07 * np.arange(scene.n)
    sketch = scene.sketch(q)
    assert sketch is not None
    shown, pose = kind.sketched(4 if kind.has_links else None)
    told = [f"shown: {shown.structure} at {_said(pose)}"]
    view = f"view: {sketch.azimuth:g} {sketch.elevation:g} {sketch.up}"
    return [*told, view, *map(written, sketch.parts)]


if __name__ == "__main__":
    found = {key: sketched(key) for key in SCENES}
    STORED.write_text(json.dumps(found, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
