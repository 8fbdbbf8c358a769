"""Which function of a scene of somebody's own raised an error."""

from __future__ import annotations

import inspect
import traceback
from pathlib import Path

import eomcheck
from eomcheck.errors import CallError, raised
from eomcheck.mechanics.scene import FUNCTIONS, Scene

HERE = Path(eomcheck.__file__).parent


def raised_in(scene: Scene, error: BaseException) -> str:
    """Return which function of the scene's own raised what, and where; "" where none did."""
    files = _files(type(scene))
    through = [x for x in traceback.extract_tb(error.__traceback__) if x.filename in files]
    if not through:
        kinds = [f"{kind.__name__}." for kind in type(scene).__mro__]
        own = isinstance(error, CallError) and error.name.startswith(tuple(kinds))
        return str(error) if own else ""
    return f"{type(scene).__name__}.{through[-1].name} {raised(error, through[-1])}"


def _files(kind: type[Scene]) -> set[str]:
    """Return the files in which functions of a kind of scene are written, but for those of ours."""
    functions = [getattr(kind, name, None) for name in FUNCTIONS]
    functions += [x for of in kind.__mro__ for x in vars(of).values()]
    codes = (getattr(inspect.unwrap(x), "__code__", None) for x in functions if callable(x))
    files = {code.co_filename for code in codes if code is not None}
    return {file for file in files if not Path(file).is_relative_to(HERE)}
