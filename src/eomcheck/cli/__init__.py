"""The command line: `eomcheck validate`, `eomcheck report`, `eomcheck bench`, `eomcheck study`.

Exit codes are those of `eomcheck.cli.app.EXIT_CODES`. Files are written before anything is printed,
and what becomes of the printing changes no exit code, unless it is lost on its way to a reader (2).
Each command imports what it needs when it runs.
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
    compare_command,
    fuzz_command,
    scene_commands,
    study_commands,
)
from eomcheck.cli.app import app, help_width, usage_error
from eomcheck.cli.study_commands import bench, draw, study
from eomcheck.console import slow_work_notice
from eomcheck.errors import DiedError, EomcheckError, WorkerError, described_error
from eomcheck.safe_output import unfailing_output

SUPERVISED = "validate", "fuzz"
"""Commands that ask outside libraries, Pinocchio and CasADi, unless told otherwise."""

for group in (bench, study, draw):
    app.add_typer(group)


def main() -> None:
    """Run the command line; bad input is one sentence and exit code 2.

    A command that runs code of a user's file or of an outside library runs in a process of its own,
    which `eomcheck.supervisor` watches.
    """
    pipe = supervisor.accept_supervision()
    if pipe is not None:
        supervisor.report_exit_code(pipe, code := _exit_code())
        sys.exit(code)
    if not supervisor.can_supervise():
        _run()
    told = sys.argv[1:]
    if told[:1] not in [[x] for x in SUPERVISED] and not any(".py:" in word for word in told):
        try:
            with calls.supervision_required():
                _run()
        except calls.UnsupervisedError:
            pass  # another way in which such code is named: a package's engine, a corpus
    sys.exit(supervisor.run_supervised(told))


def _exit_code() -> int:
    """Run the command line, and return its exit code when all its output is written."""
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
    # Matrices of a few hundred rows gain nothing from threads, and lose much where other programs
    # run. Libraries read this when they are loaded, which is after this line.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with unfailing_output():
        try:
            with slow_work_notice(" ".join(["starting", *sys.argv[1:2]])):
                how = {"prog_name": "eomcheck", "terminal_width": help_width()}
                code = app(**how, standalone_mode=False)
        except WorkerError as error:
            code = _said(str(error), 1 if isinstance(error, DiedError) else 2)
        except EomcheckError as error:
            code = _said(str(error), 2)
        except (KeyboardInterrupt, calls.UnsupervisedError):
            raise
        except BaseException as error:
            if (said := usage_error(error)) is not None:
                print(said, file=sys.stderr)
                code = 2
            elif said := outside_error(error):
                code = _said(said, 1)
            elif isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
                # Wherever a file is first asked for: not even whether it exists can be asked.
                name = Path(error.filename or "").name
                code = _said(f"{name[:40]!r}...: {len(name)} characters are no name of a file", 2)
            elif isinstance(error, Exception) or not has_run_user_code():
                raise
            else:
                # No command of ours ends so: code that is not ours wants the process to end.
                code = _said(f"no verdict: raised {described_error(error)}", 1)
        sys.exit(code if isinstance(code, int) else 0)


def _said(sentence: str, code: int) -> int:
    print(f"eomcheck: {sentence}", file=sys.stderr)
    return code


__all__ = [
    "app",
    "check_commands",
    "compare_command",
    "fuzz_command",
    "main",
    "scene_commands",
    "study_commands",
]
