"""Pyplot of matplotlib with the Agg backend, which opens no window."""

from __future__ import annotations

import matplotlib
import matplotlib.pyplot as plt

matplotlib.use("Agg")


__all__ = ["plt"]
