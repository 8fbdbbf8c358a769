"""Engines in processes of their own, each with one library in one version.

Two versions of a library, or two libraries whose dependencies conflict, so stand beside each other,
and a crash of a library is its fault and not the end of the command. `isolated` makes a class of an
adapter: its methods are requests to a process (`eomcheck.engines.engine_process`) in the
environment of the library (`eomcheck.engines.environments`), over pipes. What crosses them is the
tree of bodies or the path of the robot's file, arrays and names; scenes never do.

A process that ends, answers something else than a message or does not answer in time raises a
`CallError` that names the call and its end. It is started again for other calls; a method that has
ended it is not called again.

A process holds a model for each engine. One whose engine is gone here is dropped with the next
request: its number is queued by the garbage collector, which may run in the middle of another one.
"""

from __future__ import annotations

import atexit
import copyreg
import os
import re
import select
import signal
import subprocess
import tempfile
import threading
import time
import weakref
from abc import ABCMeta
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property, partial
from inspect import getfile, isfunction
from itertools import count
from pathlib import Path
from typing import Any, ClassVar, NoReturn, TypeVar

import eomcheck
from eomcheck import calls
from eomcheck.calls import FIRST
from eomcheck.engines.engine import Engine
from eomcheck.engines.environments import python_with
from eomcheck.engines.pipe_protocol import (
    ProtocolError,
    decoded,
    encoded,
    read_bytes,
    write_bytes,
)
from eomcheck.engines.tree_engine import TreeEngine, library_key
from eomcheck.errors import CallError, EngineError, InputError, RemoteError, located
from eomcheck.mechanics.scene import Scene
from eomcheck.supervisor import why_died

START = """
import sys
from importlib.util import module_from_spec, spec_from_file_location
folder, *numbers = sys.argv[1:]
spec = spec_from_file_location(
    "eomcheck", f"{folder}/__init__.py", submodule_search_locations=[folder]
)
sys.modules["eomcheck"] = package = module_from_spec(spec)
spec.loader.exec_module(package)
from types import ModuleType
engines = sys.modules["eomcheck.engines"] = ModuleType("eomcheck.engines")
engines.__path__ = [f"{folder}/engines"]
from eomcheck.engines.engine_process import serve
serve(*map(int, numbers))
"""
"""Program of a process: eomcheck from its folder, and of its package `engines` files alone."""

PINNED = "=="
"""Separator of the key of an engine and the version of its library."""

ANY = "*"
"""Any version of a library that its adapter supports: the newest when it was installed."""

VERSION = re.compile(r"(\d+)(\.\d+)*((a|b|rc|\.dev|\.post)\d+)?")

END = 5.0
"""Time for a process to end after its pipes are closed, s."""


class EngineProcess:
    """Process of the engines of one library, started when it is asked first.

    Args:
        requirement: the library, and what else it needs, see `python_with`.

    Attributes:
        generation: number of times that it was started.
        counts: name of a call -> how often it was made.
    """

    def __init__(self, requirement: str):
        self.requirement, self.generation = requirement, 0
        self._process: subprocess.Popen | None = None
        self._ended: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self._lock = threading.RLock()
        self._pid = 0
        self._dropped: deque[int] = deque()

    def drop(self, number: int) -> None:
        """Have the model of an engine dropped before the next request; safe in a finalizer."""
        self._dropped.append(number)

    def ask(self, name: str, task: str, *arguments: Any, slow: bool = False) -> tuple[Any, Any]:
        """Return the result of a request, and its arguments if it changed them.

        Args:
            name: name of the call in messages.
            task: sort of the request.
            arguments: its arguments.
            slow: whether it may take longer, as the first call of a name.

        Raises:
            CallError: it ended the process or gave no answer; `RemoteError` if it raised an
                exception.
            EngineError: it raised one, or the library cannot be installed.
        """
        with self._lock:
            self.check(name)
            self.start()
            limit = calls.patience() * (FIRST if slow or not self.counts[name] else 1)
            self.counts[name] += 1
            dropped = [self._dropped.popleft() for _ in range(len(self._dropped))]
            request = encoded((dropped, task, *arguments))
            try:
                reply = self._exchange(request, time.monotonic() + limit)
            except TimeoutError:
                calls.request_stack(self.pid)
                self._fail(name, calls.no_answer_text(limit, calls.patience()))
            except (EOFError, OSError):
                self._fail(name, "")
            except ProtocolError as error:
                self._fail(name, f"answered {error}")
            except BaseException:  # interrupted: its answer would be taken for the next one
                self.stop()
                raise
        return self._result(name, reply)

    def check(self, name: str) -> None:
        """Raise `CallError` if a call of this name has ended a process."""
        if name in self._ended:
            raise CallError(name, self._ended[name])

    @staticmethod
    def _result(name: str, reply: Any) -> tuple[Any, Any]:
        """Return the result and the changed arguments of a reply, or raise its exception."""
        match reply:
            case ["answer", result, changed]:
                return result, changed
            case ["error", "EngineError", message]:
                raise EngineError(message)
            case ["error", "InputError" | "UnknownNameError", message]:
                raise InputError(message)
            case ["error", _, what]:
                raise RemoteError(name, what)
            case ["ended", called, what]:
                raise CallError(called, what)
        raise CallError(name, "answered no message")

    def start(self) -> None:
        """Start the process, unless it runs."""
        if self._process is not None and self._pid == os.getpid():
            return
        python = python_with(self.requirement)
        (read, self._requests), (self._answers, write) = os.pipe(), os.pipe()
        lifeline, self._lifeline = os.pipe()
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (as long as the process)
        in_main_thread = threading.current_thread() is threading.main_thread()
        numbers = [read, write, lifeline, int(in_main_thread)]
        folder = str(Path(eomcheck.__file__).parent)
        self._process = subprocess.Popen(
            [str(python), "-I", "-c", START, folder, *map(str, numbers)],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._output,
            pass_fds=(read, write, lifeline),
            start_new_session=True,
        )
        for pipe in (read, write, lifeline):
            os.close(pipe)
        self._pid, self.generation = os.getpid(), self.generation + 1
        atexit.register(self.stop)

    @property
    def pid(self) -> int:
        """Number of the process, 0 while none runs."""
        return 0 if self._process is None else self._process.pid

    def stop(self) -> int | None:
        """Kill the process, and return its exit status."""
        process, self._process = self._process, None
        atexit.unregister(self.stop)
        if process is None or self._pid != os.getpid():
            return None
        for pipe in (self._requests, self._answers, self._lifeline):
            os.close(pipe)
        self._output.close()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        return process.wait()

    def _fail(self, name: str, what: str) -> NoReturn:
        """Stop the process after a call that it did not answer, and raise `CallError`."""
        process = self._process
        if not what and process is not None:
            with suppress(subprocess.TimeoutExpired):
                what = why_died(Path(), None, process.wait(END))
        text = self._written()
        what = located(what or "closed its pipe", calls.dumped_line(text)) + _last_line(text)
        self.stop()
        self._ended[name] = what
        raise CallError(name, what)

    def _written(self) -> str:
        """Return the text that the process wrote."""
        self._output.seek(0)
        return self._output.read().decode("utf-8", "replace")

    def _exchange(self, request: bytes, until: float) -> Any:
        """Send a request, and return the reply that comes before the time `until`."""
        os.set_blocking(self._requests, False)
        write_bytes(self._requests, request, lambda: self._wait([], [self._requests], until))
        answered = partial(self._wait, [self._answers], [], until)
        return decoded(lambda size: read_bytes(self._answers, size, answered))

    @staticmethod
    def _wait(readable: list[int], writable: list[int], until: float) -> None:
        """Wait until a pipe is ready; TimeoutError at the time `until`."""
        ready = select.select(readable, writable, [], max(0.0, until - time.monotonic()))
        if not (ready[0] or ready[1]):
            raise TimeoutError


def _last_line(text: str) -> str:
    """Return the last line that a process wrote before its stack, as the end of a sentence."""
    lines = calls.STACK_HEAD.split(text)[0].split("\n")
    last = [line.strip() for line in lines if line.strip()][-1:]
    return f" after it wrote {last[0]!r}" if last else ""


PROCESSES: list[EngineProcess] = []
"""Processes, one for each library and version that was asked for."""


@cache
def _process(requirement: str) -> EngineProcess:
    PROCESSES.append(EngineProcess(requirement))
    return PROCESSES[-1]


E = TypeVar("E", bound=Engine)


class IsolatedType(ABCMeta):
    """Class of isolated engine classes, which other processes make again by name."""

    isolates: type[TreeEngine]
    pinned: str


def adapter_of(kind: type[Engine]) -> type[Engine]:
    """Return the adapter of an isolated engine class; any other class itself."""
    return kind.isolates if isinstance(kind, IsolatedType) else kind


def isolation_hint(kind: type[Engine]) -> str:
    """Return how an optional library runs without being installed, as the end of a sentence."""
    if kind.extra is None or not issubclass(kind, TreeEngine) or adapter_of(kind) is not kind:
        return ""
    name = f"{library_key(kind)}{PINNED}{ANY}"
    return f", and runs in an environment of its own by --isolated or --engine '{name}'"


def isolated(kind: type[E], version: str = ANY) -> type[E]:
    """Return the class of an engine whose library runs in a process of its own.

    Args:
        kind: adapter that builds its model from a tree or a file.
        version: version of the library, by default `ANY`, the newest that can be installed.

    Raises:
        InputError: the engine reads the equations of a scene, or the version is none.
    """
    if not issubclass(kind, TreeEngine):
        raise InputError(
            f"engine {kind.key} cannot be isolated: it reads the equations of a scene, "
            "expected one that builds its model from a tree of bodies or a file"
        )
    check_version(kind, version)
    made: Any = _isolated(kind, version)
    return made


class _Remote(TreeEngine):
    """Engine whose model is in another process; bases of its class are this and an adapter."""

    isolates: ClassVar[type[TreeEngine]]
    pinned: ClassVar[str]
    process: ClassVar[EngineProcess]
    limits_itself = True

    def __init__(self, scene: Scene):
        self.inputs = self.inputs_of(scene)
        self._number, self._generation = next(_numbers), 0
        # The models of all engines end with the process, at the exit of this one at the latest.
        weakref.finalize(self, self.process.drop, self._number).atexit = False
        self._ask(f"{self.isolates.__name__}(scene)", "get", "inputs")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._ask(f"{self.isolates.__name__}.{name}", "get", name)[0]

    def _ask(self, name: str, task: str, *arguments: Any) -> tuple[Any, Any]:
        kind, process = self.isolates, self.process
        process.check(name)
        process.start()
        if self._generation != process.generation:
            made = f"{kind.__name__}(scene)"
            process.ask(made, "make", self._number, *_home_of(kind), self.inputs, slow=True)
            self._generation = process.generation
        return process.ask(name, task, self._number, *arguments)

    @classmethod
    @calls.limits_itself
    def version(cls) -> str:
        """Return name and version of the library, which is asked once."""
        return _version_of(cls)


@cache
def _version_of(kind: type[_Remote]) -> str:
    """Return the version of the library of an isolated engine class."""
    name = f"{kind.isolates.__name__}.version"
    return kind.process.ask(name, "version", *_home_of(kind.isolates), slow=True)[0]


def _home_of(kind: type[Engine]) -> tuple[str, str]:
    """Return the module of a class of this package, or the file of another one, and its name."""
    home = kind.__module__ if calls.is_ours(kind) else str(Path(getfile(kind)).resolve())
    return home, kind.__name__


def check_version(kind: type[TreeEngine], version: str) -> None:
    """Check the version of a library.

    Raises:
        InputError: it is none, or older than the oldest that the adapter supports.
    """
    if version == ANY:
        return
    name = library_key(kind)
    if not VERSION.fullmatch(version):
        raise InputError(f"engine = {f'{name}{PINNED}{version}'!r}, expected as in {name}==1.2.3")
    if _numbers_of(version) < _numbers_of(kind.oldest):
        raise InputError(f"version = {version!r} of {name}, expected {kind.oldest} or newer")


def _numbers_of(version: str) -> list[int]:
    """Return the numbers of a version, without those of a pre-release."""
    found = re.match(r"[\d.]*", version)
    return [int(x) for x in found[0].split(".") if x] if found else []


@cache
def _isolated(kind: type[TreeEngine], version: str) -> type[Engine]:
    requirement = " ".join(kind.requirements("" if version == ANY else version))
    members: dict[str, Any] = {
        "key": kind.key if version == ANY else f"{kind.key}{PINNED}{version}",
        "isolates": kind,
        "pinned": version,
        "process": _process(requirement),
        "__init__": _Remote.__init__,
    }
    for name in dir(kind):
        member = getattr(kind, name)
        if name.startswith("_") or member is getattr(Engine, name, None):
            continue  # what the adapter does not override is skipped here too
        if isfunction(member):
            members[name] = _request(name, kind.__name__)
        elif isinstance(member, property | cached_property):
            members[name] = property(partial(_Remote.__getattr__, name=name))
    made: Any = IsolatedType(kind.__name__, (_Remote, kind), members)
    return made


def _request(method: str, whose: str) -> Callable[..., Any]:
    """Return a method that asks the process of its engine."""

    @calls.limits_itself
    def ask(self: Any, *arguments: Any) -> Any:
        result, changed = self._ask(f"{whose}.{method}", "call", method, list(arguments))
        for mine, theirs in zip(arguments, changed or (), strict=False):
            if hasattr(mine, "__array__"):
                mine[...] = theirs
        return result

    ask.__name__ = method
    return ask


_numbers = count(1)
"""Numbers of engines, each in its process."""


def _reduced(kind: IsolatedType) -> tuple[Callable[..., Any], tuple]:
    return isolated, (kind.isolates, kind.pinned)


copyreg.pickle(IsolatedType, _reduced)  # type: ignore[arg-type]
