"""Command line entry point: `main` runs a command and returns one of `application.EXIT_CODES`.

Result files are written before anything is printed, and a failed print changes no exit code, unless
output is lost on its way to a reader (2). Each command imports its dependencies when it runs. A
command that executes user-supplied code or an outside library runs in a supervised process of its
own.
"""

from __future__ import annotations

import errno
import os
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from eomcheck import calls, supervisor
from eomcheck.class_lookup import has_run_user_code, outside_error
from eomcheck.cli import (
    check_commands,
    fuzz_command,
    scene_commands,
    study_commands,
)
from eomcheck.cli.application import app, as_typed, help_width, usage_error
from eomcheck.cli.study_commands import bench, draw, study
from eomcheck.console import slow_work_notice
from eomcheck.deprecated import current_options
from eomcheck.errors import DiedError, EomcheckError, InputError, WorkerError, described_error
from eomcheck.safe_output import unfailing_output

SUPERVISED = "check", "validate", "fuzz", "compare"
"""Commands that run a user's file, or call outside libraries by default."""

for group in (bench, study, draw):
    app.add_typer(group)


def main() -> None:
    """Run the command line; bad input is one sentence and exit code 2.

    A command that runs user-supplied code or an outside library runs in a separate process under
    `eomcheck.supervisor`.
    """
    pipe = supervisor.accept_supervision()
    if pipe is not None:
        supervisor.report_exit_code(pipe, code := _exit_code())
        sys.exit(code)
    try:
        sys.argv[1:] = words = current_options(sys.argv[1:])
    except InputError as error:
        sys.exit(_reported(str(error), 2))
    if not supervisor.can_supervise():
        _run()
    if words[:1] not in [[x] for x in SUPERVISED] and not any(".py:" in word for word in words):
        try:
            with calls.supervision_required():
                _run()
        except calls.UnsupervisedError:
            pass  # such code was named in another way: a package's engine, a stored failure
    sys.exit(supervisor.run_supervised(words))


def _exit_code() -> int:
    """Run the command line and return its exit code once all output is written."""
    code: Any = 1
    try:
        _run()
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    return code if isinstance(code, int) else 0


def _run() -> NoReturn:
    """Run the command line in this process.

    Raises:
        SystemExit: with the exit code.
    """
    # Matrices of a few hundred rows gain nothing from threads, and lose much beside other
    # programs. The libraries, not loaded yet, read these variables when they are.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with unfailing_output():
        try:
            with slow_work_notice(" ".join(["starting", *sys.argv[1:2]])):
                how = {"prog_name": "eomcheck", "terminal_width": help_width()}
                code = app(**how, standalone_mode=False)
        except WorkerError as error:
            code = _reported(str(error), 1 if isinstance(error, DiedError) else 2)
        except EomcheckError as error:
            code = _reported(str(error), 2)
        except (KeyboardInterrupt, calls.UnsupervisedError):
            raise
        except BaseException as error:
            if (message := usage_error(error)) is not None:
                print(message, file=sys.stderr)
                code = 2
            elif message := outside_error(error):
                code = _reported(message, 1)
            elif isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
                # Raised by the first access to a file, even by a test whether it exists.
                name = Path(error.filename or "").name
                code = _reported(
                    f"{name[:40]!r}...: {len(name)} characters are no name of a file", 2
                )
            elif isinstance(error, Exception) or not has_run_user_code():
                raise
            else:
                # No built-in command ends so: user-supplied code is ending the process.
                code = _reported(f"no verdict: raised {described_error(error)}", 1)
        sys.exit(code if isinstance(code, int) else 0)


def _reported(sentence: str, code: int) -> int:
    print(f"eomcheck: {as_typed(sentence, sys.argv[1:])}", file=sys.stderr)
    return code


__all__ = [
    "app",
    "check_commands",
    "fuzz_command",
    "main",
    "scene_commands",
    "study_commands",
]
