"""A motion that moves: sketches as the frames of a GIF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from eomcheck.files import replacing
from eomcheck.lab.show.canvas import canvas, paint
from eomcheck.lab.show.colors import LIGHT
from eomcheck.lab.show.drawing import Drawing
from eomcheck.lab.show.pyplot import plt
from eomcheck.mechanics import sketch as s


def draw_motion(
    sketches: Sequence[s.Sketch], times: Sequence[float], path: Path, every: int
) -> None:
    """Draw a motion into a GIF: every so many sketches a frame, and the paths of what has one."""
    drawings = [Drawing(one, LIGHT) for one in sketches]
    bounds = np.array([one.bounds for one in drawings])
    seen = np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    frames: list[Any] = []
    digits = max(0, 2 - int(np.floor(np.log10(times[-1]))))
    for k in range(0, len(drawings), every):
        drawing = drawings[k]
        axes = canvas(seen, LIGHT, 5.6)
        for trail in np.array([one.trails for one in drawings[: k + 1]]).transpose(1, 2, 0):
            axes.plot(*trail, color=LIGHT.coordinate, lw=1.2)
        paint(axes, drawing)
        axes.text(0.02, 0.03, f"t = {times[k]:.{digits}f} s", transform=axes.transAxes, fontsize=12)
        axes.figure.canvas.draw()
        frame = Image.fromarray(np.asarray(axes.figure.canvas.buffer_rgba())[..., :3])
        frames.append(frame.quantize(24, dither=Image.Dither.NONE))
        plt.close(axes.figure)
    look = {"save_all": True, "append_images": frames[1:], "loop": 0, "optimize": True}
    with replacing(path) as beside:
        frames[0].save(beside, format="GIF", duration=[80] * (len(frames) - 1) + [1200], **look)
