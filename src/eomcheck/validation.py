"""Every claim on every scene, as tests of the installed package::

    pytest --pyargs eomcheck.validation

`--eomcheck-examples N` looks at more states, `-n auto` of pytest-xdist spreads the tests, and
`-k bicycle` looks at one scene.
"""

from __future__ import annotations

from collections.abc import Callable

from eomcheck.testing import parametrize_with_claims


@parametrize_with_claims(scenes=["all"], examples=10)
def test_claims(check: Callable[[], None]) -> None:
    """Each claim holds, or is skipped where it does not apply."""
    check()
