"""Suspects of screening: told by the claims that fail, judged the worst first, by the rations."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from tests.lab.test_fuzzing import ALL, STRATUM, Wrong, plan

from eomcheck.claims.batched_claims import batchable_claims
from eomcheck.claims.finding import Finding
from eomcheck.draws.fuzz_cases import ORDINARY, FuzzCase, StructuralVariant, draw_cases
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import state_rounds
from eomcheck.lab.fuzzing.campaign import RoundResult
from eomcheck.lab.fuzzing.screening import CheckFrequency, ScreeningResult, check_case, screen
from eomcheck.scenes import Snake

FEW = ("au", "em", "kane")
FORMULATED = tuple(FORMULATIONS[key] for key in FEW)


@cache
def cases(kind: type[Snake], count: int = 2) -> list[FuzzCase]:
    return draw_cases(kind, STRATUM, (ORDINARY,), count, np.random.default_rng(2))[0]


def test_what_fails_by_check_is_suspect_in_lanes_by_the_same_claims():
    wrong = cases(Wrong)
    found = screen(wrong, FORMULATED, ALL, enclosed_every=0)
    for i, case in enumerate(wrong):
        judged = check_case(case, batchable_claims(ALL), FEW)
        failed = {one.claim for one in judged if one.verdict == "failed"}
        assert failed and found.suspects[i] == failed - set(found.not_batched)


@pytest.fixture
def judged(monkeypatch) -> list[tuple[int, frozenset[str]]]:
    """The cases, numbers here, that are judged, and by which claims."""
    asked: list[tuple[int, frozenset[str]]] = []

    def noting(case, claims, *_):
        asked.append((case, frozenset(claims)))
        return []

    monkeypatch.setattr(state_rounds, "check_case", noting)
    return asked


def looked_at(monkeypatch, found: ScreeningResult, **options) -> RoundResult:
    """Return what comes of cases of which lanes say this."""
    monkeypatch.setattr(state_rounds, "screen", lambda *how: found)
    monkeypatch.setattr(state_rounds, "update_population", lambda *how: None)
    result = RoundResult(0, StructuralVariant(2, ()), {})
    most = options.pop("most", None)
    state_rounds.screen_and_judge(plan(**options), result, range(found.count), {0, 1}, most)  # type: ignore[arg-type]
    return result


def test_of_many_suspects_the_most_suspect_are_judged(judged, monkeypatch):
    found = ScreeningResult(6, {("bias", ""): np.array([2.0, 9.0, 3.0, 0.5, 8.0, 7.0])})
    found.suspects = {i: {"bias"} for i in (0, 1, 2, 4, 5)}
    result = looked_at(monkeypatch, found, most=2)
    assert judged == [(1, frozenset({"bias"})), (4, frozenset({"bias"}))]
    assert (result.counts["suspect"], result.counts["suspects judged"]) == (5, 2)
    # Of the others nobody knows how high they are.
    assert found.scores["bias", ""].tolist() == [0.0, 0.0, 0.0, 0.5, 0.0, 0.0]


@pytest.mark.parametrize(
    ("verdict", "height"), [("failed", 3.0), ("passed", 3.0), ("inconclusive", 0.0)]
)
def test_a_suspect_is_as_high_as_it_is_judged_to_be(monkeypatch, verdict, height):
    case = cases(Snake)[0]
    said = Finding("bias", "casadi", *case, 1.5, 0.5, verdict, "made up")
    monkeypatch.setattr(state_rounds, "check_case", lambda *_: [said])
    found = ScreeningResult(1, {("bias", ""): np.array([9.0])}, {0: {"bias"}})
    looked_at(monkeypatch, found, most=1)
    assert found.scores["bias", ""].tolist() == [height]


@pytest.mark.parametrize(
    ("ration", "expected"),
    [
        (
            CheckFrequency(0, 0, 0, 0, 2),
            {0: {"null-space-embedding", "lost"}, 2: {"null-space-embedding", "lost"}},
        ),
        (CheckFrequency(0, 3, 0, 0, 0), {0: {"enclosures"}, 3: {"enclosures"}}),
        (CheckFrequency(0, 0, 0, 0, 0), {}),
    ],
)
def test_what_lanes_cannot_tell_is_judged_at_one_state_in_so_many(
    ration, expected, judged, monkeypatch
):
    claims = ("bias", "null-space-embedding", "enclosures")
    found = ScreeningResult(4, not_batched={"bias": "branches"})
    looked_at(monkeypatch, found, check_frequency=ration, claims=claims)
    names = {"lost": "bias"}
    told = {i: frozenset(names.get(x, x) for x in of) for i, of in expected.items()}
    assert dict(judged) == told and len(judged) == len(told)


def test_states_that_are_not_finite_are_judged_by_their_terms_alone(judged, monkeypatch):
    result = looked_at(
        monkeypatch,
        ScreeningResult(5, non_finite=[1, 3, 4]),
        check_frequency=CheckFrequency(0, 0, 0, 0, 2),
    )
    terms = [case for case, claims in judged if claims == {"finite-terms"}]
    assert terms == [1, 4] and result.counts["not finite"] == 3
