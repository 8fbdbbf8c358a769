"""Deprecated names of the public interface: each still works for one release, and warns.

Tables of old and new names, one for each sort of name, and one helper for each table. What stands
here is removed in the release after the one in which it was renamed.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

MODULES = {
    "eomcheck.mechanics.described": "eomcheck.descriptions",
    "eomcheck.mechanics.described.build": "eomcheck.descriptions.build",
    "eomcheck.mechanics.described.words": "eomcheck.descriptions.elements",
    "eomcheck.mechanics.described.description": "eomcheck.descriptions.described_scene",
    "eomcheck.mechanics.described.mechanism": "eomcheck.descriptions.mechanism_class",
    "eomcheck.robots": "eomcheck.descriptions.robot_files",
    "eomcheck.random_mechanisms": "eomcheck.descriptions.random_mechanisms",
    "eomcheck.engines.walk": "eomcheck.engines.tree_engine",
    "eomcheck.evaluation.doubles": "eomcheck.evaluation.evaluation",
    "eomcheck.numbers.contract": "eomcheck.numbers.generic",
    "eomcheck.numbers.differentiate": "eomcheck.numbers.tape",
    "eomcheck.motion.extrapolation": "eomcheck.motion.reference",
    "eomcheck.motion.run": "eomcheck.motion.reference_io",
    "eomcheck.motion.stored": "eomcheck.motion.reference_io",
    "eomcheck.motion.observe": "eomcheck.motion.observables",
    "eomcheck.motion.errors": "eomcheck.motion.trajectory_errors",
    "eomcheck.testing.registry": "eomcheck.testing.function_claim",
}
"""Old -> new path of modules that pages of 0.2 or stored finds import from."""


def warn(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that `old` is now called `new`, at the line `stacklevel` calls above."""
    text = f"{old} is now {new}; the old name is removed in the next release"
    warnings.warn(text, DeprecationWarning, stacklevel=stacklevel)


class _Finder(MetaPathFinder):
    """A finder of the modules in `MODULES`."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, _Alias()) if fullname in MODULES else None


class _Alias(Loader):
    """A loader that stands in for the module of the new path."""

    def exec_module(self, module: ModuleType) -> None:
        name = module.__name__
        warn(name, MODULES[name])
        sys.modules[name] = importlib.import_module(MODULES[name])


def install() -> None:
    """Let the old paths of modules be imported, once a process."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        # Before the finder of files: a package that has moved still has its files to find.
        sys.meta_path.insert(0, _Finder())


VALUES = {"not looked at": "skipped"}
"""Old -> new words of JSON documents and Records that are read back: verdicts and evidence."""


def current(value: str) -> str:
    """Return the present word for one that an older release wrote."""
    return VALUES.get(value, value)


NAMES: dict[str, dict[str, str]] = {}
"""Module -> old name -> new name of what it holds."""


def renamed(module: str, name: str) -> Any:
    """Return the object of a module that was called `name`.

    Raises:
        AttributeError: there was none.
    """
    new = NAMES.get(module, {}).get(name)
    if new is None:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    warn(f"{module}.{name}", f"{module}.{new}")
    return getattr(importlib.import_module(module), new)
