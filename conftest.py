"""hypothesis profiles: `ci` by default, `--hypothesis-profile fuzz` for long runs by hand."""

import os

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

# The matrices are small: threads cost more than they gain. To be set before numpy is imported.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

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


def pytest_configure(config: pytest.Config) -> None:
    """Draw the same cases whatever the sources say: they hold numbers that hypothesis is fond of.

    Otherwise what is drawn would depend on every edit, and on the modules imported before.
    """
    if config.getoption("--hypothesis-profile", None) in (None, "ci"):
        assert hasattr(providers, "is_local_module_file")
        providers.is_local_module_file = lambda path: False
