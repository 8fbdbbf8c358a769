"""Rules that the source keeps as a whole: what generic functions contain, and who imports whom."""

from __future__ import annotations

import ast
import builtins
import dataclasses
import importlib
import inspect
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import eomcheck
from eomcheck.claims import CLAIMS
from eomcheck.engines import BY_FORMAT, LIBRARIES, READERS
from eomcheck.engines.tree_engine import TreeEngine
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.study import Study
from eomcheck.mechanics.scene import FUNCTIONS
from eomcheck.motion import right_hand_side
from eomcheck.numbers.banded_solve import solve_banded
from eomcheck.numbers.generic import GENERIC
from eomcheck.numbers.linear import add_congruence, contiguous, matrix_product, solve
from eomcheck.scenes import SCENES
from eomcheck.testing import FUNCTION_CLAIMS

PACKAGE = Path(eomcheck.__file__).parent
WRITTEN_ONCE = ("eomcheck.scenes.", "eomcheck.formulations.", right_hand_side.__name__)

# ---- Generic functions ---------------------------------------------------------------------------

functions = pytest.mark.parametrize(
    "function",
    [f for f in GENERIC if f.__module__.startswith(WRITTEN_ONCE)],
    ids=lambda f: f"{f.__module__.removeprefix('eomcheck.')}.{f.__name__}",
)

ALLOCATION = {"zeros", "empty", "zeros_like", "concatenate", "ascontiguousarray", "array"}
METHODS = {"reshape", "angles", "root"}
OF_CHAINS = (
    "quasi_velocities",
    "chain",
    "chain_velocity",
    "chain_acceleration",
    "chain_multipliers",
)


def syntax(function: Callable) -> ast.FunctionDef:
    definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(definition, ast.FunctionDef)
    return definition


def nodes(function: Callable, *kinds: type) -> Iterator:
    for statement in syntax(function).body:
        yield from (node for node in ast.walk(statement) if isinstance(node, kinds))


def names_of(function: Callable) -> dict[str, object]:
    """Return the names that a function sees: those of its module, and what it closes over."""
    return function.__globals__ | inspect.getclosurevars(function).nonlocals


def objects_called(function: Callable) -> Iterator[tuple[str, object]]:
    """Yield (as written, object or name of a method) of each call."""
    for call in nodes(function, ast.Call):
        match call.func:
            case ast.Name(id=name):
                yield name, names_of(function).get(name, getattr(builtins, name, None))
            case ast.Attribute(value=ast.Name(id=name), attr=attribute):
                holder = names_of(function).get(name)
                known = isinstance(holder, ModuleType)
                yield f"{name}.{attribute}", getattr(holder, attribute) if known else attribute
            case _:
                yield ast.unparse(call.func), getattr(call.func, "attr", None)


def is_record(x: object) -> bool:
    return isinstance(x, type) and issubclass(x, tuple) and hasattr(x, "_fields")


def power_of_two(x: object) -> bool:
    return isinstance(x, int) and x > 0 and x & (x - 1) == 0


def test_every_function_of_every_scene_and_formulation_is_marked_as_generic():
    for scene in SCENES.values():
        for name in ("prepare", "terms", "kinematics", "speeds", "bodies", "speeds_of"):
            assert getattr(scene, name) in GENERIC, f"{scene.key}.{name}"
        for name in ("velocities", "energies", "constraint", "constraints"):
            assert getattr(scene, name) in GENERIC, f"{scene.key}.{name}"
        for name in OF_CHAINS if hasattr(scene, "chain") else ():
            assert getattr(scene, name) in GENERIC, f"{scene.key}.{name}"
    for formulation in FORMULATIONS.values():
        assert formulation.solution in GENERIC, formulation.key


@functions
def test_literals_of_generic_functions_are_integers(function: Callable):
    literals = {type(node.value) for node in nodes(function, ast.Constant)}
    assert literals <= {int, str, type(None)}


@functions
def test_generic_functions_divide_by_no_literal_but_powers_of_two(function: Callable):
    divisors = [
        node.right if isinstance(node, ast.BinOp) else node.value
        for node in nodes(function, ast.BinOp, ast.AugAssign)
        if isinstance(node.op, ast.Div)
    ]
    literal = [ast.literal_eval(d) for d in divisors if isinstance(d, ast.Constant | ast.UnaryOp)]
    assert all(power_of_two(x) for x in literal), literal


@functions
def test_generic_functions_only_add_subtract_multiply_and_divide(function: Callable):
    # Whole quotients are for sizes: numbers of most arithmetics have none.
    allowed = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.MatMult, ast.USub)
    operators = nodes(function, ast.BinOp, ast.AugAssign, ast.UnaryOp)
    other = [ast.unparse(node) for node in operators if not isinstance(node.op, allowed)]
    assert not other


@functions
def test_generic_functions_call_only_each_other_linear_algebra_and_allocation(function: Callable):
    linear = add_congruence, contiguous, matrix_product, solve, solve_banded
    allowed = [range, *linear, *GENERIC, *(getattr(np, name) for name in ALLOCATION)]
    handed_in = {argument.arg for argument in syntax(function).args.args}
    for written, called in objects_called(function):
        known = called in allowed or is_record(called) or called in METHODS
        assert known or written in handed_in, written


@functions
def test_generic_functions_branch_only_on_whether_an_argument_of_theirs_is_absent(
    function: Callable,
):
    arguments = {argument.arg for argument in syntax(function).args.args}
    for node in nodes(function, ast.If, ast.IfExp, ast.While, ast.Compare, ast.BoolOp, ast.Assert):
        test = node if isinstance(node, ast.Compare) else getattr(node, "test", node)
        match test:
            case ast.Compare(
                left=ast.Name(id=name),
                ops=[ast.Is() | ast.IsNot()],
                comparators=[ast.Constant(value=None)],
            ):
                assert name in arguments, ast.unparse(test)
            case ast.BoolOp(values=values) if all(isinstance(x, ast.Compare) for x in values):
                pass  # each of them is looked at by itself
            case _:
                pytest.fail(f"a branch on a value: {ast.unparse(test)}")


# ---- Who imports whom ----------------------------------------------------------------------------

LAYERS = (
    "deprecated calls errors console safe_output pytest_plugin",
    "atomic_write class_lookup supervisor",
    "numbers",
    "kernels mechanics",
    "descriptions",
    "scenes",
    "scene_lookup formulations",
    "evaluation",
    "engines",
    "motion",
    "draws",
    "strategies",
    "claims",
    "testing",
    "validation",
    "lab",
    "cli __main__",
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names.split()}

FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in FILES}


@cache
def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports_of(path: Path) -> set[str]:
    """Return the modules of eomcheck that a file imports, under whatever name.

    Those for annotations alone count: they are read together as well.
    """
    tree = parsed(path)
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                found |= {alias.name for alias in names}
            case ast.ImportFrom(module="eomcheck", names=names, level=0):
                # A public name stands for the module it is loaded from.
                found |= {f"eomcheck.{eomcheck._HOME.get(a.name, a.name)}" for a in names}
            case ast.ImportFrom(module=str(module), level=0, names=names):
                inner = {f"{module}.{a.name}" for a in names}
                found |= {name if name in MODULES else module for name in inner}
            case ast.ImportFrom():
                pytest.fail(f"{path}: a relative import hides its layer")
    own = {name for name in found if name.startswith("eomcheck.")}
    return own - {"eomcheck.__version__"}


def layer_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("layer", sorted({layer_of(path) for path in FILES}))
def test_no_file_imports_from_a_layer_after_its_own(layer: str):
    for path in FILES:
        if layer_of(path) == layer:
            for module in imports_of(path):
                assert RANK[module.split(".")[1]] <= RANK[layer], (path, module)


def test_no_import_goes_in_a_circle():
    rooms = {
        name: {m for m in imports_of(path) if m in MODULES and m != name}
        for name, path in MODULES.items()
    }
    # A package and the files that its first lines gather are one.
    graph = {
        name: {m for m in into if not name.startswith(f"{m}.")} for name, into in rooms.items()
    }
    assert tuple(TopologicalSorter(graph).static_order())


RANDOM = "eomcheck.descriptions.random_"


@pytest.mark.parametrize("layer", ["scenes", "formulations"])
def test_scenes_and_formulations_know_nothing_of_each_other(layer: str):
    rooms = {"errors", "deprecated", "class_lookup", "numbers", "mechanics", "descriptions", layer}
    for path in (PACKAGE / layer).glob("*.py"):
        assert {module.split(".")[1] for module in imports_of(path)} <= rooms, path
        assert not any(name.startswith(RANDOM) for name in imports_of(path)), path


def imported_by(statement: str) -> set[str]:
    """Return the top-level modules that a new process has loaded after `statement`."""
    code = f"import sys; {statement}; print(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_importing_the_package_imports_no_compiler_engine_or_plotting():
    loaded = imported_by("import eomcheck")
    assert "eomcheck" in loaded
    heavy = {"numba", "llvmlite", "casadi", "pinocchio", "matplotlib", "scipy", "hypothesis"}
    assert not loaded & heavy


def test_importing_the_engines_imports_none_of_their_libraries():
    loaded = imported_by("import eomcheck.engines, eomcheck.claims.run")
    kinds = (*LIBRARIES.values(), *READERS.values(), *BY_FORMAT["mjcf"].values())
    modules = {kind.module for kind in kinds if issubclass(kind, TreeEngine)}
    assert not loaded & {"casadi", *(module.partition(".")[0] for module in modules)}


def test_every_public_name_is_there_and_no_other():
    for name in eomcheck.__all__:
        assert getattr(eomcheck, name) is not None
        assert name in dir(eomcheck)
    with pytest.raises(AttributeError, match="no_such_name"):
        eomcheck.no_such_name  # noqa: B018


@pytest.mark.parametrize("registry", ["SCENES", "FORMULATIONS", "ENGINES"])
def test_everything_in_a_registry_is_found_under_its_own_key(registry: str):
    entries = getattr(importlib.import_module("eomcheck"), registry)
    assert entries
    assert all(key == entry.key for key, entry in entries.items())


# ---- Names ---------------------------------------------------------------------------------------

STUDY = {field.name for field in dataclasses.fields(Study)}
GIVEN = {
    "scenes": FUNCTIONS | {"description"},
    "lab/studies/stability": FUNCTIONS | STUDY,
    "formulations": {"solution", "system"},
    "lab/studies": STUDY,
    "lab/studies/operations": STUDY,
    "lab/studies/paper": STUDY,
}
"""Folder -> names of functions that its files give by contract, each its own."""

REGISTERED = {
    (function.__module__, function.__name__)
    for claim in (*CLAIMS.values(), *FUNCTION_CLAIMS.values())
    for function in (getattr(claim, x, None) for x in ("check", "sides", "evaluate"))
    if function is not None
}
"""Functions that are claims: each is called as its claim, of a scene or of functions."""


def defined(kind: type) -> dict[str, list[str]]:
    """Return the files that define each public name of a kind at the top level."""
    found: dict[str, list[str]] = {}
    for path in FILES:
        folder = path.parent.relative_to(PACKAGE).as_posix()
        for node in parsed(path).body:
            if not isinstance(node, kind) or (module_of(path), node.name) in REGISTERED:
                continue
            if kind is ast.FunctionDef and node.name in GIVEN.get(folder, ()):
                continue
            if not node.name.startswith("__"):
                found.setdefault(node.name, []).append(path.relative_to(PACKAGE).as_posix())
    return found


def test_no_class_has_a_name_twice():
    twice = {name: files for name, files in defined(ast.ClassDef).items() if len(files) > 1}
    assert not twice


def test_no_public_function_has_a_name_twice_but_by_a_contract():
    public = {x: files for x, files in defined(ast.FunctionDef).items() if not x.startswith("_")}
    assert not {name: files for name, files in public.items() if len(files) > 1}


def test_files_have_a_name_twice_only_where_their_folders_have_one_contract():
    names: dict[str, set[str]] = {}
    for path in FILES:
        if path.name != "__init__.py":
            names.setdefault(path.name, set()).add(path.parent.relative_to(PACKAGE).as_posix())
    twice = {name: folders for name, folders in names.items() if len(folders) > 1}
    studies = {name for name in twice if all(x.startswith("lab/studies/") for x in twice[name])}
    assert studies <= {"measure.py", "show.py"}
    # A study is called as its file; these two are about a file of `evaluation`.
    assert twice.keys() - studies <= {"tolerance.py", "conformance.py"}


# ---- Docstrings ----------------------------------------------------------------------------------

NAMELESS = ("Return what ", "Yield what ", "What ", "Of ", "Those ")


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of all docstrings of a file, those below attributes too."""
    for node in ast.walk(parsed(path)):
        body = getattr(node, "body", ())
        for statement in body if isinstance(body, list) else ():
            match statement:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    yield statement.lineno, text.strip()


@pytest.mark.parametrize("layer", sorted({layer_of(path) for path in FILES}))
def test_every_docstring_begins_with_the_noun_that_it_is_about(layer: str):
    nameless = [
        f"{path.relative_to(PACKAGE)}:{line}: {text.partition(chr(10))[0]}"
        for path in FILES
        if layer_of(path) == layer
        for line, text in docstrings(path)
        if text.startswith(NAMELESS)
    ]
    assert not nameless
