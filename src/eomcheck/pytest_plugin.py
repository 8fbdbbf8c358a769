"""Plug-in for pytest: two command-line options, and a folder that its processes share.

pytest loads it wherever eomcheck is installed, so it imports nothing but pytest: neither numpy nor
other subpackages. `eomcheck.testing` reads `OPTIONS`, and works without the plug-in if it is off.
"""

from __future__ import annotations

from argparse import ArgumentTypeError
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass
class Options:
    """Options of eomcheck on pytest's command line.

    Attributes:
        examples: number of random states per scene, in place of the test's own; None if not given.
        xfails: file of expected failures, in place of the one that the test names.
        shared: folder shared by the processes of pytest-xdist, None if there is one process.
    """

    examples: int | None = None
    xfails: Path | None = None
    shared: Path | None = None


OPTIONS = Options()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the command-line options."""
    group = parser.getgroup("eomcheck")
    group.addoption(
        "--eomcheck-examples",
        metavar="N",
        type=_count,
        help="random states a scene, for tests parametrized with claims",
    )
    group.addoption(
        "--eomcheck-xfails",
        metavar="FILE",
        help="expected failures, an id and a reason a line, in place of those that tests name",
    )


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise ArgumentTypeError(f"{text!r}, expected a whole number of at least 1")
    return int(text)


def pytest_configure(config: pytest.Config) -> None:
    """Store the options in `OPTIONS` before tests are collected."""
    xfails = config.getoption("--eomcheck-xfails")
    OPTIONS.examples = config.getoption("--eomcheck-examples")
    OPTIONS.xfails = None if xfails is None else config.invocation_params.dir / xfails
    # Workers of pytest-xdist on one machine have base folders beside each other.
    own = config.getoption("basetemp", None) if hasattr(config, "workerinput") else None
    OPTIONS.shared = None if own is None else Path(own).parent


def pytest_unconfigure() -> None:
    """Reset the options for the next session in this process."""
    OPTIONS.examples = OPTIONS.xfails = OPTIONS.shared = None
