"""Tests of the installed package: every claim on every scene::

    pytest --pyargs eomcheck.validation

`--eomcheck-examples N` checks N random states per scene, `-n auto` of pytest-xdist runs the tests
in parallel, and `-k bicycle` selects one scene.
"""

from __future__ import annotations

from collections.abc import Callable

from eomcheck.testing import parametrize_with_claims


@parametrize_with_claims(scenes=["all"], examples=10)
def test_claims(check: Callable[[], None]) -> None:
    """Check that each claim holds, or is skipped where it does not apply."""
    check()
