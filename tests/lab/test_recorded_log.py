"""Logs of simulators: rates by differences, equations of motion, energy, constraints, faults."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.test_recorded_answers import arm_text, printed_by
from tests.trials.recorded_answers import (
    FORMATS,
    LOG_FAULTS,
    LoggedMotion,
    log_columns,
    log_outcome,
    logged_motion,
)

from eomcheck import cli, simulate
from eomcheck.errors import InputError
from eomcheck.lab.recorded_answers import write_states
from eomcheck.lab.recorded_log import (
    check_recorded,
    difference_rates,
    is_log,
    rate_weights,
    unit_of,
)
from eomcheck.lab.recorded_table import open_table, write_table
from eomcheck.lab.report.motion_tables import write_trajectory
from eomcheck.lab.show.chart import Panel
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_named
from eomcheck.scenes import SCENES, from_urdf

CHAIN = SCENES["chain-pendulum"].example()
STEP = 0.002

# ---- Rates ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [2, 3, 6, 7])
def test_weights_are_exact_for_polynomials_through_their_nodes(size: int):
    random = np.random.default_rng(size)
    nodes = np.cumsum(random.uniform(0.5, 1.5, (20, size)), axis=1)
    for at in (nodes[:, size // 2], nodes.mean(axis=1)):
        weights = rate_weights(nodes - at[:, None], np.zeros(20))
        for power in range(size):
            slope = (weights * nodes**power).sum(axis=1)
            np.testing.assert_allclose(slope, power * at ** (power - 1.0), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("form", ["%.3f", "%.6f", "%.17g"])
@pytest.mark.parametrize("half_steps", [0, -1, 1, 2, -3])
def test_a_rate_by_differences_is_within_its_error(form: str, half_steps: int):
    t = np.cumsum(np.random.default_rng(1).uniform(0.008, 0.012, 200))
    exact = np.column_stack([np.sin(7.0 * t), np.exp(t)])
    printed = np.array([[float(form % x) for x in row] for row in exact])
    error = np.abs(printed - exact) + 1e-15
    rates = difference_rates(t, printed, error, half_steps)
    low, high = rates.rows + half_steps // 2, rates.rows - (-half_steps // 2)
    at = (t[low] + t[high]) / 2.0
    truth = np.column_stack([7.0 * np.cos(7.0 * at), np.exp(at)])
    assert (np.abs(rates.value - truth) <= rates.error).all()


def test_rows_farther_apart_are_taken_where_digits_are_few():
    t = 1e-3 * np.arange(400)
    x = np.round(np.sin(t), 4)[:, None]
    error = difference_rates(t, x, np.full_like(x, 5e-5)).error
    assert np.median(error) < 5e-5 / 1e-3 / 4


# ---- Right logs ----------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=["semi-implicit", "rk4"])
def right(request) -> tuple[str, LoggedMotion]:
    return request.param, logged_motion(CHAIN, request.param, STEP, 120)


RK4 = logged_motion(CHAIN, "rk4", STEP, 60)


def checked(path: Path, columns: dict[str, Any], scene: Scene = CHAIN) -> tuple[Any, Any, Any]:
    """Return the subjects of each verdict, the notes, and the failures of a log."""
    write_table(path, columns)
    findings, notes, _ = check_recorded(path, scene)
    verdicts: dict[str, set[str]] = {}
    for one in findings:
        verdicts.setdefault(one.verdict, set()).add(one.subject)
    return verdicts, notes, {x.subject: x.detail for x in findings if x.verdict == "failed"}


ALL = {"v against q", "a against v", "equations of motion", "energy against work"}


@pytest.mark.parametrize("form", FORMATS)
def test_a_right_log_does_not_fail_with_any_digits(form: str, right, tmp_path: Path):
    assert log_outcome(None, CHAIN, right[1], form, tmp_path / "a.csv") == "missed"


def test_a_log_with_all_digits_passes_and_semi_implicit_steps_are_said(right, tmp_path: Path):
    method, motion = right
    verdicts, notes, _ = checked(tmp_path / "a.npz", log_columns(CHAIN, motion))
    assert notes[0] == "log of 120 rows, 0.238 s"
    assert "time steps of 0.002 s" in notes
    said = "v is half a step behind q: semi-implicit Euler or leapfrog" in notes
    assert said == (method == "semi-implicit")
    if method == "rk4":
        assert verdicts == {"passed": ALL}
    else:  # its energy is of first order
        assert verdicts == {"passed": ALL - {"energy against work"}} | {
            "inconclusive": {"energy against work"}
        }


def test_a_log_without_accelerations_and_forces_is_checked_by_differences(tmp_path: Path):
    path = tmp_path / "a.npz"
    columns = log_columns(CHAIN, RK4)
    few = {name: x for name, x in columns.items() if not name.startswith("a[")}
    verdicts, notes, failed = checked(path, few)
    assert "no columns a: accelerations are differences of v" in notes
    assert not failed
    assert "equations of motion" in verdicts["passed"]
    states = {name: x for name, x in few.items() if not name.startswith("tau[")}
    _, notes, failed = checked(path, states)
    assert "no columns tau: no forces are applied" in notes
    assert "missing" in failed["equations of motion"]


def test_a_motion_of_our_own_with_steps_of_any_size_does_not_fail(tmp_path: Path):
    for key, formulation in (("sleigh", "au"), ("chain-pendulum", "kane")):
        scene = SCENES[key].example()
        trajectory = simulate(scene, formulation, 0.5, rtol=1e-10, atol=1e-10)
        write_trajectory(trajectory, tmp_path / "a.csv")
        findings, notes, _ = check_recorded(tmp_path / "a.csv", scene)
        assert not [x for x in findings if x.verdict == "failed"]
        assert notes[1].startswith("time steps differ: from ")
        assert {"v against q", "energy"} <= {x.subject for x in findings if x.verdict == "passed"}


def test_a_wrapped_angle_is_unwrapped_and_said(tmp_path: Path):
    fast = RK4._replace(q=RK4.q + 40.0 * RK4.t[:, None], v=RK4.v + 40.0)
    wrapped = fast._replace(q=(fast.q + np.pi) % (2 * np.pi) - np.pi)
    verdicts, notes, _ = checked(tmp_path / "a.npz", log_columns(CHAIN, wrapped))
    assert "v against q" in verdicts["passed"]
    assert [note for note in notes if note.startswith("q[θ_1] is wrapped by 2π")]


def test_dampers_take_energy(tmp_path: Path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm_text(2).replace("<limit", '<dynamics damping="2"/><limit'))
    scene = from_urdf(path)
    motion = logged_motion(scene, "rk4", STEP, 60)
    verdicts, _, failed = checked(tmp_path / "a.npz", log_columns(scene, motion), scene)
    assert verdicts == {"passed": ALL}
    assert not failed


GUIDES = Path(__file__).parents[2] / "docs" / "guides"


def test_the_log_of_the_guide_passes_and_one_without_the_damper_is_named(tmp_path: Path):
    scene = from_urdf(GUIDES / "rod.urdf")
    for words, names in (([], set()), (["0"], {"equations of motion", "energy against work"})):
        command = [sys.executable, str(GUIDES / "rod_log.py"), *words]
        printed = subprocess.run(command, capture_output=True, check=True, text=True).stdout
        (tmp_path / "log.csv").write_text(printed)
        findings, notes, _ = check_recorded(tmp_path / "log.csv", scene)
        failed = {x.subject: x.detail for x in findings if x.verdict == "failed"}
        assert failed.keys() == names
        assert "v is half a step behind q: semi-implicit Euler or leapfrog" in notes
    assert "without springs and dampers" in failed["equations of motion"]


@pytest.mark.parametrize("damper", [True, False])
def test_a_log_without_accelerations_is_judged_up_to_half_a_step_of_the_integrator(
    damper: bool, tmp_path: Path
):
    """Differences of v are half a step beside the accelerations of semi-implicit Euler."""
    command = [sys.executable, str(GUIDES / "rod_log.py"), *([] if damper else ["0"])]
    lines = subprocess.run(command, capture_output=True, check=True, text=True).stdout.split()
    columns = lines[0].split(",")
    kept = [k for k, name in enumerate(columns) if not name.startswith("a[")]
    rows = [",".join(line.split(",")[k] for k in kept) for line in lines]
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    findings, _, _ = check_recorded(tmp_path / "log.csv", from_urdf(GUIDES / "rod.urdf"))
    verdicts = {x.subject: x.verdict for x in findings}
    assert verdicts["equations of motion"] == ("inconclusive" if damper else "failed")


def test_a_motion_without_applied_forces_passes_by_its_inertia(tmp_path: Path):
    scene = SCENES["chain-pendulum"].example()
    motion = simulate(scene, "kane", 0.2)
    write_trajectory(motion, tmp_path / "a.npz")
    verdicts, _, failed = checked(tmp_path / "a.npz", dict(np.load(tmp_path / "a.npz")), scene)
    assert not failed and "equations of motion" in verdicts["passed"]


# ---- Faults --------------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize("fault", LOG_FAULTS, ids=lambda x: x.id)
def test_a_fault_of_a_log_is_named(fault, tmp_path: Path, sized):
    for form in sized(FORMATS, FORMATS[1:2]):
        assert log_outcome(fault, CHAIN, RK4, form, tmp_path / "a.csv") == "named"


def test_the_code_of_a_failing_log_reads_it_and_prints_what_differs(tmp_path: Path, capsys):
    chosen, short = {"v-one-sign", "tau-one-half", "q-jumps"}, LoggedMotion(*(x[:40] for x in RK4))
    shown = set()
    for fault in (x for x in LOG_FAULTS if x.id in chosen):
        wrong = short._replace(**fault.change(short, CHAIN))
        write_table(tmp_path / "a.csv", log_columns(CHAIN, wrong))
        findings, _, _ = check_recorded(tmp_path / "a.csv", CHAIN)
        failed = [x for x in findings if x.verdict == "failed"]
        assert failed, fault.id
        for one in failed:
            place, *entries = printed_by(one.as_python(), capsys)
            assert place.startswith("row ") and f"q = {one.state.q}" in place
            assert entries and all("recorded" in x and "off by" in x for x in entries)
            assert not any("off by 0," in x for x in entries)
            shown.add((fault.id, one.subject, entries[0].split(":")[0]))
    assert ("v-one-sign", "v against q", "v[θ_2]") in shown
    assert ("tau-one-half", "equations of motion", "tau[θ_3]") in shown
    assert ("q-jumps", "v against q") in {x[:2] for x in shown}


def test_rows_that_lie_a_step_beside_do_not_fail_the_equations(tmp_path: Path):
    def of(id: str) -> tuple[Any, Any, Any]:
        (fault,) = [x for x in LOG_FAULTS if x.id == id]
        wrong = RK4._replace(**fault.change(RK4, CHAIN))
        return checked(tmp_path / "a.npz", log_columns(CHAIN, wrong))

    for id in ("v-row-before", "a-row-before", "a-and-tau-row-before"):
        verdicts, _, failed = of(id)
        assert "equations of motion" in verdicts["passed"], id
        assert {"v against q", "a against v"} & failed.keys(), id
    _, _, failed = of("tau-sign")
    assert "wrong sign" in failed["equations of motion"]
    _, _, failed = of("tau-in-Nmm")
    assert "as if without it" in failed["energy against work"]


def test_errors_of_first_order_decide_nothing(tmp_path: Path):
    """Every tenth row of semi-implicit Euler: v is a twentieth of a step behind q."""
    fine = logged_motion(CHAIN, "semi-implicit", STEP / 10, 300)
    coarse = LoggedMotion(*(x[::10] for x in fine))
    verdicts, _, failed = checked(tmp_path / "a.npz", log_columns(CHAIN, coarse))
    assert not failed
    assert {"v against q", "a against v"} & verdicts["inconclusive"]
    findings, _, _ = check_recorded(tmp_path / "a.npz", CHAIN)
    (detail,) = [x.detail for x in findings if x.subject == "v against q"]
    assert detail.startswith("v is 0.05 steps behind q: errors of first order")


def test_a_constraint_that_is_violated_from_the_first_row_on_is_named(tmp_path: Path, capsys):
    scene = SCENES["sleigh"].example()
    trajectory = simulate(scene, "kane", 0.5)
    write_trajectory(trajectory, tmp_path / "a.npz")
    table = open_table(tmp_path / "a.npz")
    (chunk,) = table.chunks()
    columns = dict(zip(table.names, chunk.values.T, strict=True))
    sideways = {"v[x]": columns["v[x]"] - 0.1, "v[y]": columns["v[y]"] + 0.2}
    _, _, failed = checked(tmp_path / "b.npz", columns | sideways, scene)
    findings, _, _ = check_recorded(tmp_path / "b.npz", scene)
    (edge,) = [x for x in findings if (x.subject, x.verdict) == ("constraint edge", "failed")]
    _, entry = printed_by(edge.as_python(), capsys)
    assert entry.startswith("a v + b of edge / (m/s): ") and ", 0 expected" in entry
    assert "edge is violated from the first row on" in failed["constraint edge"]


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 0.1], "has 2 rows: a log needs 3 for rates"),
        ([0.0, 0.1, 0.1, 0.2], "row 2 (line 4): t = 0.1 s is repeated, 0.1 s in the row before"),
        ([0.0, 0.1, 0.05, 0.2], "row 2 (line 4): t = 0.05 s goes back, 0.1 s in the row before"),
    ],
)
def test_times_that_do_not_increase_are_one_sentence(times, message: str, tmp_path: Path):
    columns = log_columns(CHAIN, LoggedMotion(*(x[: len(times)] for x in RK4)))
    write_table(tmp_path / "a.csv", columns | {"t": np.array(times)})
    with pytest.raises(InputError) as error:
        check_recorded(tmp_path / "a.csv", CHAIN)
    assert message in str(error.value)


def test_forces_on_some_coordinates_alone_are_one_sentence(tmp_path: Path):
    columns = log_columns(CHAIN, RK4)
    del columns["tau[θ_2]"]
    write_table(tmp_path / "a.npz", columns)
    with pytest.raises(InputError, match=r"has no column tau\[θ_2\], 0 if none acts"):
        check_recorded(tmp_path / "a.npz", CHAIN)


def test_one_wrong_row_is_named_between_rows_that_are_judged_in_any_case(tmp_path: Path):
    tau = RK4.tau.copy()
    tau[30, 1] += 0.5
    _, _, failed = checked(tmp_path / "a.npz", log_columns(CHAIN, RK4._replace(tau=tau)))
    assert "; row 30; 1 of 60 rows differ" in failed["equations of motion"]


def test_a_jump_that_is_no_full_turn_is_no_wrap(tmp_path: Path):
    q = RK4.q.copy()
    q[30:, 1] += 4.0
    _, notes, failed = checked(tmp_path / "a.npz", log_columns(CHAIN, RK4._replace(q=q)))
    assert "jumps to row 30" in failed["v against q"]
    assert not [note for note in notes if "wrapped" in note]


def test_every_constraint_and_the_energy_of_a_log_without_forces_are_judged(tmp_path: Path):
    scene = SCENES["rolling-disk"].example()
    assert scene.r > 1
    write_trajectory(simulate(scene, "kane", 0.5), tmp_path / "a.npz")
    findings, _, _ = check_recorded(tmp_path / "a.npz", scene)
    expected = {f"constraint {name}" for name in scene.constraint_names} | {"energy against work"}
    assert expected <= {x.subject for x in findings}


# ---- Free bases ----------------------------------------------------------------------------------


def test_a_log_of_a_free_base_is_read_and_another_convention_is_named(tmp_path: Path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm_text(2).replace('<link name="base"/>', BASE_LINK))
    scene = scene_named(f"{path}:floating")
    motion = logged_motion(scene, "rk4", STEP, 40)
    case = scene, motion, "%.12g", tmp_path / "a.csv", "body axes, angular first"
    assert log_outcome(None, *case) == "missed"
    wrong = log_outcome(None, *case, header="world axes, angular first")
    assert "base: v is the rate of q with a twist of body axes" in wrong


BASE_LINK = (
    '<link name="base"><inertial><mass value="3"/><inertia ixx="0.1" iyy="0.12" izz="0.09" '
    'ixy="0" ixz="0" iyz="0"/></inertial></link>'
)

# ---- The command ---------------------------------------------------------------------------------


def test_states_of_a_scene_that_depends_on_time_are_no_log(tmp_path: Path):
    scene = SCENES["turntable-ball"].example()
    write_states(scene, tmp_path / "a.npz", 4)
    table = open_table(tmp_path / "a.npz")
    assert ("t" in table.names) == scene.depends_on_time
    assert not is_log(table, scene)
    write_table(tmp_path / "b.npz", log_columns(CHAIN, RK4))
    assert is_log(open_table(tmp_path / "b.npz"), CHAIN)


def test_a_chart_shows_errors_and_work_over_time(tmp_path: Path):
    write_table(tmp_path / "motion.npz", log_columns(CHAIN, RK4))
    _, _, chart = check_recorded(tmp_path / "motion.npz", CHAIN)
    assert chart is not None
    assert chart.name == "motion"
    titles = ["v against q", "a against v", "equations of motion", "energy and work"]
    assert [title for (title,) in chart.panels] == titles
    panel = chart.panels["energy and work",]
    assert isinstance(panel, Panel)
    assert panel.keys == ["energy", "work"]
    energy, work = (np.array(line.y, float) for line in panel.lines)
    np.testing.assert_allclose(energy, work, atol=1e-6 * np.abs(energy).max())


def test_a_log_is_checked_and_drawn_by_the_command(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)

    def run(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["eomcheck", "check", *words])
        with pytest.raises(SystemExit) as stop:
            cli._run()
        return int(stop.value.code or 0)

    write_table(tmp_path / "log.csv", log_columns(CHAIN, RK4))
    assert run("log.csv", "--scene", "chain-pendulum", "--figures", ".") == 0
    out = capsys.readouterr().out
    assert "4 of 4 quantities passed" in out
    for name in ("log.svg", "log-dark.svg"):
        assert f"written: {name}" in out
        assert (tmp_path / name).stat().st_size > 10_000
    write_table(tmp_path / "log.csv", log_columns(CHAIN, RK4._replace(tau=-RK4.tau)))
    assert run("log.csv", "--scene", "chain-pendulum") == 1
    assert "1 of 4 quantities failed" in capsys.readouterr().out
    write_states(CHAIN, tmp_path / "s.npz", 2)
    columns = dict(np.load(tmp_path / "s.npz")) | {"M[0;0]": np.ones(2)}
    write_table(tmp_path / "s.npz", columns)
    assert run("s.npz", "--scene", "chain-pendulum", "--figures", ".") == 2
    assert "only a log, with a column t, is drawn" in capsys.readouterr().err


def test_a_unit_is_named_where_one_row_resolves_it_and_none_contradicts():
    allowed, degree = np.full(2, 0.1), 180.0 / np.pi
    known, small = (np.array([5.0, 0.2]), np.array([0.1, 0.0]))
    sides = [(0, degree * small + 1.0, small, allowed), (7, degree * known - 1.0, known, allowed)]
    assert unit_of(sides) == "in degrees"
    assert unit_of(sides[:1]) == ""
    assert unit_of([*sides, (9, known, known, allowed)]) == ""


def test_the_compared_rate_has_the_allowed_error_of_its_failure(tmp_path: Path):
    """That of a first-order step is part of it."""
    path = tmp_path / "log.csv"
    log = logged_motion(CHAIN, "semi-implicit", STEP, 60)
    columns = log_columns(CHAIN, log._replace(v=1.5 * log.v))
    write_table(path, columns)
    found, _, _ = check_recorded(path, CHAIN)
    failed = next(one for one in found if one.subject == "v against q")
    assert failed.verdict == "failed"
    errors = {abs(x.recorded - x.expected): x.allowed for x in failed.compared}
    assert errors[failed.observed] == failed.allowed


# ---- Logs of a simulator -------------------------------------------------------------------------

ARM = """<mujoco><option timestep="0.002"/><worldbody>
<body><joint name="hip" axis="0 1 0" damping="0.3"/><geom size="0.05 0.1" type="cylinder" pos="0.1 0 0.2"/>
<body pos="0.2 0 0.4"><joint name="knee" axis="1 2 0" damping="0.2"/><geom size="0.04 0.2 0.1" type="box"
 pos="0 0.1 0.2"/></body></body></worldbody></mujoco>"""  # noqa: E501


def mujoco_log(path: Path, integrator: str, digits: str = "%.9g", after: bool = False) -> Path:
    """Write the log of an arm under torques: a state, and qacc and forces of the step from it.

    Of that step's end with `after`, as one writes it after `mj_step`.
    """
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(ARM)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    data, rows = mujoco.MjData(model), []
    data.qpos[:] = 0.4, -0.3
    for k in range(150):
        data.qfrc_applied[:] = 3.0 * np.sin(9.0 * k * STEP + 1.0), np.cos(7.0 * k * STEP)
        state = data.time, *data.qpos, *data.qvel
        mujoco.mj_step(model, data)
        state = (data.time, *data.qpos, *data.qvel) if after else state
        rows.append((*state, *data.qacc, *data.qfrc_applied))
    names = [f"{x}[{joint}]" for x in ("q", "v", "a", "tau") for joint in ("hip", "knee")]
    np.savetxt(path, rows, digits, ",", header=",".join(["t", *names]), comments="")
    return path


@pytest.mark.parametrize(
    ("integrator", "note"),
    [
        ("EULER", "half a step ahead of v: semi-implicit Euler, dampers implicit"),
        ("IMPLICITFAST", "half a step ahead of v: semi-implicit Euler, dampers implicit"),
        ("IMPLICIT", "half a step ahead of v: implicit Euler in the velocities"),
        ("RK4", "half a step ahead of v: explicit Euler or leapfrog"),
    ],
)
def test_a_log_of_mujoco_does_not_fail_whatever_its_integrator(
    tmp_path: Path, integrator: str, note: str
):
    path = mujoco_log(tmp_path / "log.csv", integrator)
    (tmp_path / "arm.xml").write_text(ARM)
    found, notes, _ = check_recorded(path, scene_named(str(tmp_path / "arm.xml")))
    assert [str(one) for one in found if one.verdict == "failed"] == []
    assert any(note in one for one in notes)
    means = [one.detail for one in found if "means of the step to the state" in one.detail]
    assert len(means) == (integrator == "RK4")


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICIT", "RK4"])
@pytest.mark.parametrize("mistake", ['damping="0.31"', 'pos="0.1 0 0.203"', "no damper"])
def test_a_log_of_mujoco_fails_with_another_model(tmp_path: Path, integrator: str, mistake: str):
    path = mujoco_log(tmp_path / "log.csv", integrator)
    old = {"pos": 'pos="0.1 0 0.2"', "no ": 'damping="0.2"'}.get(mistake[:3], 'damping="0.3"')
    text = ARM.replace(old, "" if mistake == "no damper" else mistake)
    (tmp_path / "arm.xml").write_text(text)
    found, _, _ = check_recorded(path, scene_named(str(tmp_path / "arm.xml")))
    assert "equations of motion" in {one.subject for one in found if one.verdict == "failed"}


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICIT"])
def test_rows_may_be_written_after_a_step_of_mujoco(tmp_path: Path, integrator: str):
    path = mujoco_log(tmp_path / "log.csv", integrator, after=True)
    (tmp_path / "arm.xml").write_text(ARM)
    found, notes, _ = check_recorded(path, scene_named(str(tmp_path / "arm.xml")))
    assert [str(one) for one in found if one.verdict == "failed"] == []
    assert any("a is half a step behind v: " in one and "implicit" in one for one in notes)
    assert any("a and tau are those of the state of the row before" in one for one in notes)
    (tmp_path / "arm.xml").write_text(ARM.replace('damping="0.2"', 'damping="0.21"'))
    found, _, _ = check_recorded(path, scene_named(str(tmp_path / "arm.xml")))
    failed = [one.subject for one in found if one.verdict == "failed"]
    assert failed[0] == "equations of motion"


def test_steps_that_solve_no_implicit_equation_are_not_excused(tmp_path: Path):
    """One row of a that is off by a hundredth of a percent."""
    path = mujoco_log(tmp_path / "log.csv", "EULER", "%.12g")
    (tmp_path / "arm.xml").write_text(ARM)
    lines = path.read_text().splitlines()
    cells = lines[70].split(",")
    cells[5] = f"{float(cells[5]) * 1.0001:.12g}"
    path.write_text("\n".join([*lines[:70], ",".join(cells), *lines[71:]]) + "\n")
    _, notes, _ = check_recorded(path, scene_named(str(tmp_path / "arm.xml")))
    assert not any("implicit" in one and "ahead" in one for one in notes)
