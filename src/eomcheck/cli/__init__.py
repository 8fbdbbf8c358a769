"""The command line: `eomcheck validate`, `eomcheck report`, `eomcheck bench`, `eomcheck study`.

Exit codes are those of `eomcheck.cli.app.EXIT_CODES`. Files are written before anything is printed,
and what becomes of the printing changes no exit code, unless it is lost on its way to a reader (2).
Each command imports what it needs when it runs.
"""

from __future__ import annotations

import os
import sys

from eomcheck.cli import checking, comparing, drawing, fuzzing, motions
from eomcheck.cli.app import app, help_width, usage_error
from eomcheck.cli.study import bench, draw, study
from eomcheck.console import said_at_work
from eomcheck.errors import EomcheckError
from eomcheck.output import unfailing

for group in (bench, study, draw):
    app.add_typer(group)


def main() -> None:
    """Run the command line; bad input is one sentence and exit code 2."""
    # Matrices of a few hundred rows gain nothing from threads, and lose much where other programs
    # run. Libraries read this when they are loaded, which is after this line.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    with unfailing():
        try:
            with said_at_work(" ".join(["starting", *sys.argv[1:2]])):
                how = {"prog_name": "eomcheck", "terminal_width": help_width()}
                code = app(**how, standalone_mode=False)
                sys.exit(code if isinstance(code, int) else 0)
        except EomcheckError as error:
            print(f"eomcheck: {error}", file=sys.stderr)
            sys.exit(2)
        except Exception as error:
            said = usage_error(error)
            if said is None:
                raise
            print(said, file=sys.stderr)
            sys.exit(2)


__all__ = ["app", "checking", "comparing", "drawing", "fuzzing", "main", "motions"]
