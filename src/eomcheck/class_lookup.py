"""Lookup of classes by name: in a registry, an installed package, or a user's file.

A name is a registry key, the name of an entry point, `path/to/file.py:Class` or
`package.module:Class`. User code is imported under supervision (`eomcheck.calls`), and its files
are recorded, so that a later error can be attributed to a line of it.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any, Generic, NamedTuple, TypeVar

from eomcheck import calls
from eomcheck.deprecated import shown
from eomcheck.errors import (
    CallError,
    EomcheckError,
    InputError,
    UnknownNameError,
    described_error,
    did_you_mean,
    innermost_outside,
    raised,
)

T = TypeVar("T")


class LookupKind(NamedTuple, Generic[T]):
    """A sort of class that can be looked up, such as engines.

    Attributes:
        word: its noun in messages: "scene", "engine".
        base: common base class.
        registry: key -> built-in class.
    """

    word: str
    base: type[T]
    registry: Mapping[str, type[T]]

    @property
    def group(self) -> str:
        """The entry-point group in which installed packages register their classes."""
        return f"eomcheck.{self.word}s"


def class_named(kind: LookupKind[T], name: object) -> type[T]:
    """Return the class of a name.

    Args:
        kind: sort of the class.
        name: a key of the registry, `path/to/file.py:Class`, `package.module:Class`, or the name of
            an entry point.

    Raises:
        UnknownNameError: there is no such key or entry point.
        InputError: no such file or module, it cannot be run, or has no such class.
    """
    if isinstance(name, str) and name in kind.registry:
        return kind.registry[name]
    code = home_of_code(name)
    if code is not None:
        home, of = code
        return _class_in(module_named(home), of, kind, home)
    if isinstance(name, str) and name.endswith(".py"):
        raise InputError(f"{kind.word} = {name!r}, expected {name}:Class")
    known = announced(kind)
    if name not in known:
        raise UnknownNameError(kind.word, name, (*kind.registry, *known))
    value = known[str(name)].value
    return _class_in(_installed(value.partition(":")[0]), value.partition(":")[2], kind, value)


def object_named(name: str, required: bool = False) -> Any:
    """Return the object `path/to/file.py:NAME` or `package.module:NAME`; None for other names.

    Args:
        name: name of the object.
        required: reject a NAME that does not exist; otherwise the object is None.

    Raises:
        InputError: no such file or module, it cannot be run, or no such NAME.
    """
    code = home_of_code(name)
    if code is None:
        return None
    home, of = code
    names = vars(module_named(home))
    if required and of not in names:
        public = [
            key
            for key, value in names.items()
            if not key.startswith("_") and not isinstance(value, ModuleType)
        ]
        raise InputError(f"{home!r} has no {of!r}{did_you_mean(of, public)}")
    return names.get(of)


def home_of_code(name: object) -> tuple[str, str] | None:
    """Split `path/to/file.py:NAME` or `package.module:NAME` into (file or module, NAME).

    None for other names: registry keys and entry points.
    """
    home, colon, of = name.rpartition(":") if isinstance(name, str) else ("", "", "")
    return (home, of) if colon and home and of.isidentifier() else None


def module_named(home: str) -> ModuleType:
    """Return the module of a file, or the one of this name.

    Args:
        home: `path/to/file.py` or `package.module`.

    Raises:
        InputError: no such file or module, or it cannot be run.
    """
    return _in_file(Path(home)) if home.endswith(".py") else _installed(home)


def location_of(kind: type) -> str:
    """Return the name by which `class_named` finds a class of user code again; "" if by none.

    A file in the current folder, or below it, has its path from there.
    """
    name, module = kind.__name__, kind.__module__
    file = getattr(sys.modules.get(module), "__file__", None)
    if kind.__qualname__ != name or file is None or module == "__main__":
        return ""
    if file not in _run_here or "." in module:
        return f"{module}:{name}"
    path, current = Path(file).resolve(), Path.cwd().resolve()
    return f"{path.relative_to(current) if path.is_relative_to(current) else path}:{name}"


def announced(kind: LookupKind[Any]) -> dict[str, EntryPoint]:
    """Return name -> entry point of the classes of installed packages, built-in ones excluded."""
    points = {point.name: point for point in entry_points(group=kind.group)}
    return {name: point for name, point in points.items() if name not in kind.registry}


def in_file(path: str, name: str) -> type:
    """Return the class `name` of a Python file; called by the reproducer code of findings.

    Raises:
        InputError: no such file, it cannot be run, or it has no such class.
    """
    return _class_in(_in_file(Path(path)), name, LookupKind("class", object, {}), path)


def _class_in(module: ModuleType, name: str, kind: LookupKind[T], home: str) -> type[T]:
    candidate = getattr(module, name, None)
    if isinstance(candidate, type) and issubclass(candidate, kind.base):
        return candidate
    if isinstance(candidate, type):
        raise InputError(f"{name} in {home!r} does not derive from eomcheck's {kind.base.__name__}")
    instead = getattr(type(candidate), "instead", "") if calls.is_ours(type(candidate)) else ""
    if kind.word == "scene" and instead:
        raise InputError(f"{name} in {home!r} is no scene: {instead.format(f'{home}:{name}')}")
    own = [
        key
        for key, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__
        if issubclass(value, kind.base)
    ]
    has = ", ".join(own) or "none"
    hint = did_you_mean(name, own)
    raise InputError(f"{home!r} has no {kind.word} {name!r}{hint}; it has: {has}")


def _installed(name: str) -> ModuleType:
    """Return the module of this name; the current folder is searched after all others."""
    current = str(Path.cwd())
    if current not in sys.path and "" not in sys.path:
        sys.path.append(current)
    return _run(name, lambda: importlib.import_module(name))


def _in_file(path: Path) -> ModuleType:
    """Return a file as a module, under the name that an import from its folder would use."""
    if not path.is_file():
        raise InputError(f"{str(path)!r} is not a file")
    name, path = path.stem, path.resolve()
    if not name.isidentifier():
        raise InputError(f"{str(path)!r} cannot be imported: {name!r} is no name in Python")
    if _home_of(name) not in (None, str(path)):
        raise InputError(f"{str(path)!r} has the name of another module, {name}")
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module, execute = importlib.util.module_from_spec(spec), spec.loader.exec_module

    def load() -> ModuleType:
        sys.modules[name] = module
        try:
            execute(module)
        except BaseException:
            del sys.modules[name]
            raise
        return module

    with _importable(str(path.parent)):
        return _run(str(path), load)


def _home_of(name: str) -> str | None:
    """Return the file of the module of this name; "" if it has no file, None if there is none."""
    known = sys.modules.get(name)
    if known is not None:
        return getattr(known, "__file__", None) or ""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None
    if spec is None or spec.loader is None:  # a mere folder of that name is no module
        return None
    return spec.origin or ""


@contextmanager
def _importable(folder: str) -> Iterator[None]:
    """Search modules in a folder first inside the block, and last after it for later imports."""
    known = folder in sys.path
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        if not known:
            sys.path.append(folder)


def _run(home: str, load: Callable[[], ModuleType]) -> ModuleType:
    calls.require_supervision()
    try:
        with shown():
            module = calls.call(f"import of {home}", load, slow=True)
    except EomcheckError:
        raise
    except Exception as error:
        what = described_error(error)
        if isinstance(error, CallError):
            if not error.by_exception:
                raise  # no answer: a failure of that code, and no bad input
            what = error.text
        raise InputError(f"{home!r} cannot be imported: {what}") from error
    _run_here.add(getattr(module, "__file__", None) or "")
    return module


_run_here: set[str] = set()
"""Files of the modules that were imported by lookups."""


def has_run_user_code() -> bool:
    """Return whether code of a user's file or an installed package was run by a lookup."""
    return bool(_run_here)


def outside_error(error: BaseException) -> str:
    """Return the file, function and line outside this package that raised an error; "" if none.

    Such code is a file that was looked up, or one that it imports and that is not installed.
    """
    if isinstance(error, CallError):
        return str(error)
    frames = extract_tb(error.__traceback__) if _run_here else []
    at = innermost_outside(frames, _run_here)
    return "" if at is None else f"{Path(at.filename).name}: {at.name} {raised(error, at)}"
