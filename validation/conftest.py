"""Options of the validation suite: which snakes, and how many examples."""

from collections.abc import Callable

import pytest
from hypothesis import settings

from eomcheck.lab.option_parsing import parse_interval


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("eomcheck")
    group.addoption("--links", default="1..8", help="links of the snakes drawn, N or N..M")
    group.addoption("--examples", type=int, help="examples per claim, by default the profile's")


@pytest.fixture
def links(request: pytest.FixtureRequest) -> tuple[int, int]:
    return parse_interval(request.config.getoption("--links"))


@pytest.fixture
def examples(request: pytest.FixtureRequest) -> int | None:
    return request.config.getoption("--examples")


@pytest.fixture
def few(examples: int | None, sized: Callable[[int, int], int]) -> int:
    """Examples of a test that looks at each by all formulations, in balls too."""
    most = settings().max_examples
    return examples or sized(most, max(most // 3, 1))
