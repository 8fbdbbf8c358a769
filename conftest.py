"""hypothesis profiles: `ci` by default, `--hypothesis-profile fuzz` for long runs by hand."""

import os
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

# The matrices are small: threads cost more than they gain. To be set before numpy is imported.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# What is printed is compared: it is not to depend on who looks at it. To be taken away before
# eomcheck.console is imported, which asks once; colours of pytest are chosen by --color.
for told in ("COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
    os.environ.pop(told, None)

T = TypeVar("T")

slow = [HealthCheck.too_slow, HealthCheck.data_too_large]
settings.register_profile(
    "ci",
    max_examples=40,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=slow,
)
settings.register_profile("fuzz", max_examples=1000, deadline=None, suppress_health_check=slow)
settings.load_profile("ci")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--all`."""
    parser.addoption("--all", action="store_true", help="all cases, and as many draws as at night")


@pytest.fixture(scope="session")
def sized(request: pytest.FixtureRequest) -> Callable[[T, T], T]:
    """A choice between how much is looked at with `--all` and how much otherwise."""
    return lambda most, few: most if request.config.getoption("--all") else few


@pytest.hookimpl(trylast=True)  # whatever else chooses has chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep every n-th case of a test marked `sampled(n)`; the others are for the night."""
    if config.getoption("--all"):
        return
    seen: Counter[str] = Counter()
    left: list[pytest.Item] = []
    for item in items:
        marker, test = item.get_closest_marker("sampled"), item.nodeid.partition("[")[0]
        if marker is not None and seen[test] % marker.args[0]:
            left.append(item)
        seen[test] += 1
    config.hook.pytest_deselected(items=left)
    chosen = set(left)
    items[:] = [item for item in items if item not in chosen]


def pytest_configure(config: pytest.Config) -> None:
    """Draw the same cases whatever the sources say: they hold numbers that hypothesis is fond of.

    Otherwise what is drawn would depend on every edit, and on the modules imported before.
    """
    config.addinivalue_line("markers", "sampled(n): every n-th case, all of them with --all")
    if config.getoption("--hypothesis-profile", None) in (None, "ci"):
        assert hasattr(providers, "is_local_module_file")
        providers.is_local_module_file = lambda path: False
