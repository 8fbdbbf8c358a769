"""The study of long runs: what is measured, and what remedies change."""

from __future__ import annotations

import numpy as np
import pytest
from tests.lab.test_tables import trajectory
from tests.widths import check_sheets_fit

from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.table import print_tables
from eomcheck.lab.store.record_file import Records
from eomcheck.lab.studies import long_run
from eomcheck.lab.studies.long_run import REMEDIES, STUDY, cells, find_run

ENDS = "end", "largest"
SHORT = {"end": 6.0, "formulation": ["au", "kane"]}


def test_every_formulation_runs_and_remedies_only_where_constraints_can_be_left():
    known = [(c["formulation"], c["remedy"]) for c in cells()]
    drifting = [key for key, f in FORMULATIONS.items() if f.level == "acceleration"]
    assert [key for key, remedy in known if remedy == "none"] == list(FORMULATIONS)
    for remedy in REMEDIES.keys() - {"none"}:
        assert [key for key, other in known if other == remedy] == drifting


def test_no_output_time_is_one_at_which_the_velocity_was_just_projected():
    times = long_run.output_times(1000.0)
    off = np.abs(times / long_run.INTERVAL - np.rint(times / long_run.INTERVAL))
    assert times[-1] < 1000.0 and (np.diff(times) > 0).all()
    assert off.min() > 1e-6


def test_errors_are_those_at_the_end_and_the_largest_before(monkeypatch):
    start = long_run._start_energy(trajectory().scene)
    found = trajectory(energy=start * (1 + np.array([0.1, -0.3, 0.2])))
    monkeypatch.setattr(long_run, "simulate", lambda *arguments, **options: found)
    settings = {"formulation": "kane", "remedy": "none", "t_end": 2.5, "tolerance": 1e-6}
    errors = long_run._long_run(settings).errors
    ends = [errors[f"{name}_{of}"] for name in ("constraint", "energy") for of in ENDS]
    assert ends == pytest.approx([2e-3, 4e-3, 0.2, 0.3])


@pytest.mark.night
def test_remedies_stop_the_drift_and_are_told_with_their_laws(tmp_path, capsys):
    with Records(tmp_path / "long.db") as records:
        found = STUDY.measure(records, **SHORT)
        assert STUDY.measure(records, **SHORT) == found
    assert len(found) == 1 + 1 + 2 and {r.status for r in found} == {"done"}
    plain, fed, cast = (find_run(found, "au", remedy) for remedy in REMEDIES)
    bound = find_run(found, "kane", "none")
    for one in (fed, cast, bound):
        assert one.errors["constraint_end"] < plain.errors["constraint_end"] / 2
    assert np.isfinite(plain.errors["constraint_exponent"])
    assert abs(bound.errors["constraint_largest"]) < 1e-10
    assert all(r.errors["energy_largest"] < 1e-4 for r in found)
    print_tables(STUDY.tables(found))
    check_sheets_fit(STUDY.tables(found))
    said = capsys.readouterr().out
    assert "feedback" in said and "exponent" in said
    STUDY.write(found, tmp_path)
    assert (tmp_path / "long-run.svg").stat().st_size > 10_000


@pytest.mark.parametrize("wrong", [{"end": 1.0}, {"end": np.nan}, {"tolerance": 0.0}])
def test_an_end_or_tolerance_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        list(cells(**wrong))


def keys_of(**options) -> set[str]:
    return {cell["formulation"] for cell in cells(**options)}


def test_the_quick_study_is_a_part_of_the_full_one():
    assert keys_of(quick=True) < keys_of()
    ends = {(c["t_end"], c["tolerance"]) for c in cells(end=50.0, formulation=["kane"])}
    assert ends == {(50.0, 1e-6)} and keys_of(end=50.0, formulation=["kane"]) == {"kane"}
