"""Plant one fault at a time into a copy of the source, and see the checks catch and name it."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from tests.faults import COMPOSED, DESCRIBED, FAULTS, OWN, SHARED, TREES
from tests.mutants import PACKAGE, Mutant
from tests.samples import random_scene, random_state

from eomcheck.claims import CLAIMS, Finding, speeds_and_chains
from eomcheck.claims.run import RunSelection, make_case_with_engines
from eomcheck.descriptions import tree_model
from eomcheck.descriptions.tree_model import MAKERS
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import GENERIC
from eomcheck.scenes import SCENES, ChainPendulum, Snake

HOME = "eomcheck.descriptions"
_numbers = count()


@contextmanager
def planted(file: str, source: str) -> Iterator[ModuleType]:
    """Run `source` as a module of its own, beside the real one."""
    marked = len(GENERIC)
    described = file.startswith(DESCRIBED) and file != TREES
    name = f"{HOME}.{Path(file).stem}" if described else f"planted_{next(_numbers)}"
    module = ModuleType(name)
    module.__file__ = str(PACKAGE / file)
    with anew(HOME) if described else nullcontext():
        sys.modules[name] = module
        try:
            exec(compile(source, file, "exec"), module.__dict__)
            yield module
        finally:
            sys.modules.pop(name)
            del GENERIC[marked:]


@contextmanager
def anew(package: str) -> Iterator[None]:
    """Let the modules of a package be imported once more, as copies beside the real ones."""
    holder = sys.modules[package]
    real = {name: x for name, x in sys.modules.items() if name.startswith(f"{package}.")}

    def leave() -> None:
        for name in [name for name in sys.modules if name.startswith(f"{package}.")]:
            del sys.modules[name]
            vars(holder).pop(name.removeprefix(f"{package}."), None)

    leave()
    try:
        yield
    finally:
        leave()
        sys.modules.update(real)
        vars(holder).update({name.removeprefix(f"{package}."): x for name, x in real.items()})


def first_failure(scene: type[Scene], formulations: dict) -> Finding | None:
    """Look at a few random states in Python, claims in their order; return what fails first.

    What comes after that is not looked at: it could not be what fails first.
    """
    selection = RunSelection(
        tuple(f for f in formulations.values() if f.applies_to(scene)),
        RunSelection.of().engines,
        RunSelection.of().claims,
    )
    for seed in range(3):
        random = np.random.default_rng(seed)
        right = random_scene(SCENES[scene.key], random)
        # The state is right even where the fault is in a.
        state = random_state(right, random)
        made = scene(**{name: getattr(right, name) for name in scene.ranges(1)})
        case = make_case_with_engines(made, state, selection)
        for claim in selection.claims if case.finite else ("finite-terms",):
            for finding in case.evaluate(CLAIMS[claim]):
                if finding.verdict == "failed":
                    return finding
    return None


@contextmanager
def with_fault(fault: Mutant) -> Iterator[tuple[type[Scene], dict[str, Any]]]:
    """Yield the kind of scene and the formulations, one of which has the fault."""
    with planted(fault.file, fault.planted()) as module:
        key = Path(fault.file).stem
        if fault.file == TREES:
            with tree_functions_of(module):
                yield SCENES.get(fault.scene, ChainPendulum), FORMULATIONS
        elif fault.kind == "scene":
            yield kind_in(module, fault.file, SCENES.get(fault.scene)), FORMULATIONS
        elif hasattr(speeds_and_chains, key):
            with patch.object(speeds_and_chains, key, module):
                yield Snake, formulation_in(module, key)
        else:
            yield Snake, formulation_in(module, key)


@contextmanager
def tree_functions_of(module: ModuleType) -> Iterator[None]:
    """Let models of trees call the functions of this module."""
    makers = {name: getattr(module, maker.__name__) for name, maker in MAKERS.items()}
    tree_model._function.cache_clear()
    with patch.dict(MAKERS, makers):
        yield
    tree_model._function.cache_clear()


def kind_in(module: ModuleType, file: str, other: type[Scene] | None = None) -> type[Scene]:
    """Return the scene with the fault in `file`; one that is built on it, if it is no scene's."""
    if file == TREES:
        return ChainPendulum
    if file in OWN:
        return getattr(module, OWN[file].__name__)
    kind = other or SHARED[file]
    path = Path(inspect.getfile(kind))
    with planted(str(path), path.read_text(encoding="utf-8")) as caller:
        if file.startswith(DESCRIBED):
            return getattr(caller, kind.__name__)
        scene = with_shared(caller, module, kind)
    if file == COMPOSED:
        if other is not None:  # of its Jacobians, as of who writes no terms
            scene.derived_functions = scene.derived_functions | {"terms"}
        module.derive_missing(scene)
    return scene


def with_shared(caller: ModuleType, module: ModuleType, kind: type[Scene]) -> type[Scene]:
    """Return the scene in `caller`, or with the functions there, which call those of `module`."""
    shared = {name: x for name, x in vars(module).items() if inspect.isfunction(x)}
    vars(caller).update({name: x for name, x in shared.items() if name in vars(caller)})
    written = {name: x for name, x in vars(caller).items() if inspect.isfunction(x)}
    own = {name: staticmethod(x) for name, x in written.items() if hasattr(kind, name)}
    return getattr(caller, kind.__name__, None) or type(kind.__name__, (kind,), own)


def formulation_in(module: ModuleType, key: str) -> dict[str, Any]:
    """Return all formulations, that of `key` from `module`."""
    found = [x for x in vars(module).values() if isinstance(x, type(FORMULATIONS[key]))]
    return FORMULATIONS | {found[0].key: found[0]}


@pytest.mark.sampled(24)
@pytest.mark.parametrize("file", (*OWN, *SHARED))
def test_the_source_as_it_is_shows_no_fault(file: str):
    source = (PACKAGE / file).read_text(encoding="utf-8")
    with planted(file, source) as module:
        assert first_failure(kind_in(module, file), FORMULATIONS) is None


@pytest.mark.sampled(16)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.id)
def test_a_planted_fault_is_caught_and_named(fault: Mutant):
    with with_fault(fault) as (kind, formulations):
        failure = first_failure(kind, formulations)
    assert failure is not None, "not caught"
    assert failure.claim == fault.claim, str(failure)
    assert fault.says in str(failure)
