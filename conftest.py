"""hypothesis profiles: `ci` by default, `--hypothesis-profile fuzz` for long runs by hand."""

import os
import signal
from collections import Counter
from collections.abc import Callable, Generator
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

# A shell that is no terminal's has what runs beside it ignore interrupts; tests raise them.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

T = TypeVar("T")

slow = [HealthCheck.too_slow, HealthCheck.data_too_large]
always = settings(deadline=None, suppress_health_check=slow)


def load_ci(examples: int) -> None:
    """Load the profile `ci` with so many examples."""
    settings.register_profile("ci", always, max_examples=examples, derandomize=True, database=None)
    settings.load_profile("ci")


load_ci(20)
settings.register_profile("fuzz", always, max_examples=1000)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--all`."""
    parser.addoption("--all", action="store_true", help="all cases, and as many draws as at night")


@pytest.fixture(scope="session")
def sized(request: pytest.FixtureRequest) -> Callable[[T, T], T]:
    """A choice between how much is looked at with `--all` and how much otherwise."""
    return lambda most, few: most if request.config.getoption("--all") else few


@pytest.hookimpl(trylast=True)  # whatever else chooses has chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave for the night all of a test marked `night`, and most cases of one `sampled(n)`."""
    if config.getoption("--all"):
        return
    seen: Counter[str] = Counter()
    left: list[pytest.Item] = []
    for item in items:
        marker, test = item.get_closest_marker("sampled"), item.nodeid.partition("[")[0]
        skipped = marker is not None and seen[test] % marker.args[0]
        if skipped or item.get_closest_marker("night"):
            left.append(item)
        seen[test] += 1
    config.hook.pytest_deselected(items=left)
    chosen = set(left)
    items[:] = [item for item in items if item not in chosen]


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """Skip a test of a library or a package of robots that is not installed, with the reason."""
    from eomcheck.errors import EngineError  # not before the environment above is set

    try:
        return (yield)
    except EngineError as error:
        if "not installed" in str(error):
            pytest.skip(str(error))
        raise


def pytest_configure(config: pytest.Config) -> None:
    """Draw the same cases whatever the sources say: they hold numbers that hypothesis is fond of.

    Otherwise what is drawn would depend on every edit, and on the modules imported before.
    """
    config.addinivalue_line("markers", "sampled(n): every n-th case, all of them with --all")
    config.addinivalue_line("markers", "night: with --all only")
    if config.getoption("--all"):
        load_ci(40)
    if config.getoption("--hypothesis-profile", None) in (None, "ci"):
        assert hasattr(providers, "is_local_module_file")
        providers.is_local_module_file = lambda path: False
