"""Deprecated names of the public interface: each works in 0.3, and warns.

Tables of old and new names, one for each sort of name, and one helper for each table. An entry is
removed in the release after the one in which its name changed.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

MODULES = {
    "eomcheck.mechanics.described": "eomcheck.descriptions",
    "eomcheck.mechanics.described.build": "eomcheck.descriptions.build",
    "eomcheck.mechanics.described.words": "eomcheck.descriptions.elements",
    "eomcheck.mechanics.described.description": "eomcheck.descriptions.described_scene",
    "eomcheck.mechanics.described.mechanism": "eomcheck.descriptions.mechanism_class",
    "eomcheck.descriptions.words": "eomcheck.descriptions.elements",
    "eomcheck.descriptions.description": "eomcheck.descriptions.described_scene",
    "eomcheck.descriptions.mechanism": "eomcheck.descriptions.mechanism_class",
    "eomcheck.robots": "eomcheck.scenes",
    "eomcheck.random_mechanisms": "eomcheck.descriptions.random_mechanisms",
    "eomcheck.engines.base": "eomcheck.engines.engine",
    "eomcheck.engines.files": "eomcheck.engines",
    "eomcheck.engines.tree": "eomcheck.engines.tree_engine",
    "eomcheck.engines.walk": "eomcheck.engines.tree_engine",
    "eomcheck.evaluation.doubles": "eomcheck.evaluation.evaluation",
    "eomcheck.evaluation.point": "eomcheck.evaluation.scene_quantities",
    "eomcheck.mechanics.tree": "eomcheck.mechanics.records",
    "eomcheck.formulations.base": "eomcheck.formulations.formulation",
    "eomcheck.lab.store.cells": "eomcheck.lab.study",
    "eomcheck.lab.store.record": "eomcheck.lab.store.record_file",
    "eomcheck.lab.store.records": "eomcheck.lab.store.record_file",
    "eomcheck.numbers.contract": "eomcheck.numbers.generic",
    "eomcheck.numbers.differentiate": "eomcheck.numbers.tape",
    "eomcheck.lab.store.workers": "eomcheck.lab.store.parallel_map",
    "eomcheck.lab.store.provenance": "eomcheck.lab.store.record_file",
    "eomcheck.lab.store.executors": "eomcheck.lab.store.parallel_map",
    "eomcheck.motion.extrapolation": "eomcheck.motion.reference",
    "eomcheck.motion.run": "eomcheck.motion.reference_solution",
    "eomcheck.motion.stored": "eomcheck.motion.reference_solution",
    "eomcheck.motion.observe": "eomcheck.motion.observables",
    "eomcheck.motion.errors": "eomcheck.motion.reference_solution",
    "eomcheck.testing.registry": "eomcheck.claims.registry",
}
"""Old -> new path of modules that pages of 0.2 or stored failures import from.

`from PACKAGE import MODULE` asks the package under its new name: hence `descriptions.words`.
"""


REMOVED = "the old name is removed in 0.4"


def _notice(old: str, new: str) -> str:
    """Return the sentence that a name has changed."""
    return f"{old} is now {new}; {REMOVED}"


def _both_given(names: str) -> Exception:
    """Return the InputError that an old and its new name are given together."""
    from eomcheck.errors import InputError  # not at the top: the plugin of pytest loads this module

    return InputError(f"{names} are both given, expected one")


def warn(old: str, new: str, stacklevel: int | None = 3) -> None:
    """Emit a DeprecationWarning, `old` is now `new`, at the line `stacklevel` calls above.

    Without a `stacklevel`, at the innermost line outside this package.
    """
    text = _notice(old, new)
    if stacklevel is not None:
        warnings.warn(text, DeprecationWarning, stacklevel=stacklevel)
        return
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_INSIDE):
        frame = frame.f_back
    place = frame.f_code.co_filename, frame.f_lineno, frame.f_globals.get("__name__")
    registry = frame.f_globals.setdefault("__warningregistry__", {})
    warnings.warn_explicit(text, DeprecationWarning, *place, registry)


_INSIDE = str(Path(__file__).parent), "<frozen abc>"
"""Beginnings of the names of files of this package, and of what runs between it and a user."""


@contextmanager
def shown() -> Iterator[None]:
    """Show warnings of this module inside the block: by default Python shows none of a module's.

    Unless options of Python decide about warnings.
    """
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.filterwarnings("default", f".*{REMOVED}", DeprecationWarning)
        yield


class _Finder(MetaPathFinder):
    """An import finder of the modules in `MODULES`."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, _Alias()) if fullname in MODULES else None


class _Alias(Loader):
    """An import loader that replaces the old module by the one of the new path."""

    def exec_module(self, module: ModuleType) -> None:
        name = module.__name__
        warn(name, MODULES[name])
        sys.modules[name] = importlib.import_module(MODULES[name])


def install() -> None:
    """Install the import finder of old module paths, once per process."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        # Before the finder of files, which would still find the files of a moved package.
        sys.meta_path.insert(0, _Finder())


OPTIONS: dict[str, dict[str, str]] = {
    "compare": {"--states": "--examples"},
    "fuzz": {"--ration": "--check-frequency", "--states": "--examples"},
    "prove": {"--points": "--examples"},
    "simulate": {"--draws": "--examples"},
    "study long-run": {"--t-end": "--end"},
}
"""Command, such as "fuzz" or "study paper" -> old -> new name of its options."""


def current_options(words: Sequence[str]) -> list[str]:
    """Return a command line with the new names of its options; print one line for each old one."""
    current = list(words)
    names = OPTIONS.get(" ".join(words[:2])) or OPTIONS.get(" ".join(words[:1]), {})
    end = current.index("--") if "--" in current else len(current)
    for i, word in enumerate(current[:end]):
        option, equals, value = word.partition("=")
        if option in names:
            if any(x.partition("=")[0] == names[option] for x in words[:end]):
                raise _both_given(f"{option} and {names[option]}")
            current[i] = f"{names[option]}{equals}{value}"
            print_notice(option, names[option])
    return current


def print_notice(old: str, new: str) -> None:
    """Print that an old form of a command line is now another one."""
    print(f"eomcheck: {_notice(old, new)}", file=sys.stderr)


VALUES = {"not looked at": "skipped"}
"""Old -> new verdicts and evidence of JSON documents and Records that are read back."""


def current(value: str) -> str:
    """Return the current form of a value written by an older release."""
    return VALUES.get(value, value)


RECORD_KEYS = {
    study: {
        "strata": "variants",
        "stratum": "variant",
        "ration": "check_frequency",
        "lost": "not batched",
        "open": "undecided",
        "find": "failure",
    }
    for study in ("fuzz", "fuzz-population", "fuzz-find")
}
"""Study -> old -> new names of settings and series in its Records."""


def current_keys(study: str, named: dict[str, Any]) -> dict[str, Any]:
    """Return settings or series of a Record by their current names."""
    names = RECORD_KEYS.get(study, {})
    return {names.get(name, name): value for name, value in named.items()}


NAMES: dict[str, dict[str, str]] = {
    "eomcheck": {"Dependence": "ConstraintRank"},
    "eomcheck.testing": {"Functions": "EquationsOfMotion"},
    "eomcheck.descriptions.elements": {"square": "perpendicular"},
    "eomcheck.descriptions.mechanism_class": {"kind_of": "scene_class_of"},
    "eomcheck.lab.store.parallel_map": {"spread": "parallel_map"},
    "eomcheck.lab.studies.paper.measure": {"scene_of": "coil_of"},
    "eomcheck.mechanics.records": {"velocity": "velocity_from_speeds"},
    "eomcheck.mechanics.sketch": {
        "Constraint": "ConstraintMark",
        "Joint": "JointMark",
        "Spring": "SpringMark",
        "place": "position_dimensions",
        "turned_by": "plane_angle",
    },
    "eomcheck.motion.right_hand_side": {"rates_on": "trace_rates"},
    "eomcheck.motion.reference_solution": {
        "constraint_drift": "constraint_error_drift",
        "energy_drift": "energy_error_drift",
        "Run": "ReferenceRun",
    },
    "eomcheck.numbers.tape": {"live": "live_entries"},
    "eomcheck.motion.reference": {"consistent_velocity": "extended_velocity"},
}
"""Module -> old name -> new name of an object in it; the module has a `__getattr__` for these."""


def renamed(module: str, name: str) -> Any:
    """Return the object of a module by an old name.

    Raises:
        AttributeError: there was none of this name.
    """
    new = NAMES.get(module, {}).get(name)
    if new is None:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    warn(f"{module}.{name}", f"{module}.{new}", 4)
    return getattr(importlib.import_module(module), new)


def getattr_of(module: str) -> Callable[[str], Any]:
    """Return the `__getattr__` of a module with old names."""

    def __getattr__(name: str) -> Any:
        return renamed(module, name)

    return __getattr__


FIELDS: dict[str, dict[str, str]] = {
    "Joint": {
        "place": "origin",
        "turn": "orientation",
        "relaxed": "rest_position",
        "follows": "mimics",
    },
    "Accuracy": {"silent": "silently_wrong"},
    "Bricard": {"closed": "closed_state"},
    "Contact": {"told": "directions"},
    "MechanismSource": {"left_out": "ignored", "doubtful": "warnings", "source": "file"},
    "Mechanism": {"made": "source"},
    "Scene": {
        "drawn_coordinates": "coordinate_sample_ranges",
        "pictured": "display_pose",
        "composed": "derived_functions",
    },
    "mechanism": {"first": "dependent"},
    "parameter": {"drawn": "sample_range"},
    "parallel_map": {"where": "executor"},
    "run_cells": {"where": "executor"},
    "scene_states": {"of": "states_of"},
}
"""Class or function -> old -> new name of its fields, or of its keywords."""

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type)


def old_keywords(function: F) -> F:
    """Decorate a function, or a NamedTuple, so that it takes its old keywords too."""
    if not isinstance(function, type):
        return _taking_old(function, function.__name__)
    kind: Any = function
    kind.__new__ = _taking_old(kind.__new__, kind.__name__)
    kind._replace = _taking_old(kind._replace, kind.__name__, "._replace")
    return cast(F, old_attributes(kind))


def _taking_old(function: F, owner: str, method: str = "") -> F:
    """Return a function that takes the old keywords of `owner` too."""
    names = FIELDS[owner]

    @wraps(function)
    def called(*arguments: Any, **options: Any) -> Any:
        for old in names.keys() & options.keys():
            if names[old] in options:
                raise _both_given(f"{owner}: {old} and {names[old]}")
            warn(f"{owner}{method}({old}=)", f"{names[old]}=")
            options[names[old]] = options.pop(old)
        return function(*arguments, **options)

    return cast(F, called)


def old_attributes(kind: C) -> C:
    """Decorate a class so that its instances and subclasses have their old attributes too."""
    for old, new in FIELDS[kind.__name__].items():
        if old not in vars(kind):
            setattr(kind, old, _Attribute(old, new))
    return kind


class _Attribute:
    """An old attribute: reads the new one."""

    def __init__(self, old: str, new: str):
        self.old, self.new = old, new

    def __get__(self, instance: Any, owner: type) -> Any:
        warn(f"{owner.__name__}.{self.old}", self.new)
        return getattr(owner if instance is None else instance, self.new)


def take_old_attributes(kind: type, base: type) -> None:
    """Give a subclass of `base` under its new name what it, or a mixin, has by an old name.

    Called again where such an attribute is read, because it may be assigned later.
    """
    # Not by `issubclass`: classes under construction have no cache of their own yet (`abc`).
    owners = [one for one in kind.__mro__ if one not in base.__mro__]
    for old, new in FIELDS[base.__name__].items():
        owner = next((one for one in owners if {old, new} & vars(one).keys()), None)
        if owner is None or old not in vars(owner):
            continue
        warn(f"{owner.__name__}.{old}", new, stacklevel=None)
        home = owner if base in owner.__mro__ else kind
        setattr(home, new, vars(owner)[old])
        if home is owner:
            delattr(owner, old)
