"""Classes by name: from a registry, an installed package, or a user's file."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from sysconfig import get_paths
from traceback import extract_tb
from types import ModuleType
from typing import Any, Generic, NamedTuple, TypeVar

from eomcheck import calls
from eomcheck.errors import (
    CallError,
    EomcheckError,
    InputError,
    UnknownNameError,
    described_error,
    did_you_mean,
    raised,
)

T = TypeVar("T")


class LookupKind(NamedTuple, Generic[T]):
    """What is looked up.

    Attributes:
        word: what one is called: "scene", "engine".
        base: the class that all derive from.
        registry: key -> class, of our own.
    """

    word: str
    base: type[T]
    registry: Mapping[str, type[T]]

    @property
    def group(self) -> str:
        """The group of entry points by which installed packages announce theirs."""
        return f"eomcheck.{self.word}s"


def class_named(kind: LookupKind[T], name: object) -> type[T]:
    """Return the class that `name` stands for.

    Args:
        kind: what it should be.
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
        module = _in_file(Path(home)) if home.endswith(".py") else _installed(home)
        return _class_in(module, of, kind, home)
    if isinstance(name, str) and name.endswith(".py"):
        raise InputError(f"{kind.word} = {name!r}, expected {name}:Class")
    known = announced(kind)
    if name not in known:
        raise UnknownNameError(kind.word, name, (*kind.registry, *known))
    value = known[str(name)].value
    return _class_in(_installed(value.partition(":")[0]), value.partition(":")[2], kind, value)


def object_named(name: str) -> Any:
    """Return what `path/to/file.py:NAME` or `package.module:NAME` stands for, None of other names.

    Raises:
        InputError: no such file or module, or it cannot be run.
    """
    code = home_of_code(name)
    if code is None:
        return None
    home, of = code
    module = _in_file(Path(home)) if home.endswith(".py") else _installed(home)
    return getattr(module, of, None)


def home_of_code(name: object) -> tuple[str, str] | None:
    """The file or module, and the name in it, of `path/to/file.py:NAME` or `package.module:NAME`.

    None of other names, which import nothing that is not installed for eomcheck.
    """
    home, colon, of = name.rpartition(":") if isinstance(name, str) else ("", "", "")
    return (home, of) if colon and home and of.isidentifier() else None


def announced(kind: LookupKind[Any]) -> dict[str, EntryPoint]:
    """Return name -> entry point of those that installed packages announce, ours left out."""
    points = {point.name: point for point in entry_points(group=kind.group)}
    return {name: point for name, point in points.items() if name not in kind.registry}


def in_file(path: str, name: str) -> type:
    """Return the class called `name` in a Python file, as code that shows a finding loads it.

    Raises:
        InputError: no such file, it cannot be run, or it has no such class.
    """
    return _class_in(_in_file(Path(path)), name, LookupKind("class", object, {}), path)


def _class_in(module: ModuleType, name: str, kind: LookupKind[T], home: str) -> type[T]:
    found = getattr(module, name, None)
    if isinstance(found, type) and issubclass(found, kind.base):
        return found
    if isinstance(found, type):
        raise InputError(f"{name} in {home!r} does not derive from eomcheck's {kind.base.__name__}")
    instead = getattr(type(found), "instead", "") if calls.is_ours(type(found)) else ""
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
    """Return the module of this name; the current folder counts, after all others."""
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        sys.path.append(here)
    return _run(name, lambda: importlib.import_module(name))


def _in_file(path: Path) -> ModuleType:
    """Return the file as a module, under the name by which its folder would import it."""
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
    """Return the file of the module of this name, if there is one; "" of one without a file."""
    known = sys.modules.get(name)
    if known is not None:
        return getattr(known, "__file__", None) or ""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None
    if spec is None or spec.loader is None:  # a folder of that name is no module of its own
        return None
    return spec.origin or ""


@contextmanager
def _importable(folder: str) -> Iterator[None]:
    """Look for modules first in a folder; afterwards last of all, for what is imported later."""
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
        module = calls.call(f"import of {home}", load, slow=True)
    except EomcheckError:
        raise
    except Exception as error:
        what = described_error(error)
        if isinstance(error, CallError):
            what = error.what.removeprefix("raised ")
        raise InputError(f"{home!r} cannot be imported: {what}") from error
    _run_here.add(getattr(module, "__file__", None) or "")
    return module


_run_here: set[str] = set()
"""Files of the modules that were looked up."""


def has_run_user_code() -> bool:
    """Return whether code of a file or of an installed package was looked up and run."""
    return bool(_run_here)


def outside_error(error: BaseException) -> str:
    """Return which code outside this package raised an error, and in which line; "" where none did.

    Once a file was looked up, that is it, or one that it imports and that is not installed.
    """
    if isinstance(error, CallError):
        return str(error)
    installed = [Path(x) for name, x in get_paths().items() if name not in ("scripts", "data")]
    for at in reversed(extract_tb(error.__traceback__) if _run_here else []):
        file = Path(at.filename)
        known = at.filename.startswith("<") or file.is_relative_to(Path(__file__).parent)
        if at.filename in _run_here or not (known or any(map(file.is_relative_to, installed))):
            return f"{file.name}: {at.name} {raised(error, at)}"
    return ""
