"""`eomcheck simulate`: which motions are integrated, from where, by what, and its exit code."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomcheck
from eomcheck import cli
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import ChainPendulum, FourBarChain, Sleigh, Snake

END = "0.5"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What motions are asked for; the first and the last of each are finished."""
    seen: list[Any] = []

    def one(scene: Any, key: str, t_end: float, **how: Any) -> Any:
        seen.append(SimpleNamespace(scene=scene, key=key, t_end=t_end, **how))
        return SimpleNamespace(status="finished")

    def many(scene: Any, key: str, t_end: float, **how: Any) -> Any:
        status = ["finished"] * len(how["q0"])
        if len(status) == 3:
            status[1] = "failed"
        elif len(status) == 2:
            status = ["failed"] * 2
        one(scene, key, t_end, **how)
        return SimpleNamespace(status=np.array(status))

    monkeypatch.setattr(eomcheck, "simulate", one)
    monkeypatch.setattr(eomcheck, "simulate_many", many)
    for name in ("print_trajectories", "print_many", "chart_of_many"):
        monkeypatch.setattr(f"eomcheck.lab.report.motion_tables.{name}", lambda found: found)
    monkeypatch.setattr(
        "eomcheck.lab.show.chart_matplotlib.draw_chart",
        lambda chart, path: seen.append(path.name),
    )
    return seen


def code(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["eomcheck", "simulate", *words])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


@pytest.mark.parametrize(
    ("words", "scene", "scale", "seed", "speeds"),
    [
        ((), Sleigh.example(), 0.01, 0, None),
        (("--scale", "2.5", "--seed", "6"), Sleigh.example(), 2.5, 6, None),
        (("--scale", "0", "--speeds", "3,-2"), Sleigh.example(), 0.0, 0, [3.0, -2.0]),
        (("--seed", "7"), ChainPendulum.example(), 0.01, 7, None),
        (("--scale", "0.02"), FourBarChain.example(), 0.02, 0, None),
    ],
)
def test_draws_are_normal_about_the_start_of_the_scene_first_of_q_then_of_u(
    words, scene, scale, seed, speeds, asked, monkeypatch
):
    assert code(monkeypatch, scene.key, "--end", END, "--examples", "4", *words) == 0
    (found,) = asked
    q, v = scene.initial_state()
    u = eomcheck.speeds_of(scene, q, v) if v.any() else np.zeros(scene.p)
    random = np.random.default_rng(seed)
    q0 = q + scale * random.standard_normal((4, scene.n))
    u0 = (u if speeds is None else speeds) + scale * random.standard_normal((4, scene.p))
    if isinstance(scene, FourBarChain):
        q0 = np.array([assembled_position(scene, one) for one in q0])
    assert np.array_equal(found.q0, q0) and np.allclose(found.u0, u0, rtol=1e-15, atol=0.0)
    assert (found.key, found.t_end, found.executor, found.max_steps) == ("kane", 0.5, None, 0)


@pytest.mark.parametrize(("draws", "ended", "drawn"), [("4", 0, 1), ("3", 1, 1), ("2", 1, 0)])
def test_draws_are_plotted_if_some_end_and_are_1_unless_all_do(
    draws, ended, drawn, asked, monkeypatch, capsys, tmp_path
):
    path = tmp_path / "a.svg"
    words = "--examples", draws, "--plot", str(path)
    assert code(monkeypatch, "sleigh", "--end", END, *words) == ended
    assert asked[1:] == [path.name] * drawn
    assert ("written: " in capsys.readouterr().out) == bool(drawn)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--scale", "-0.5"), "--scale -0.5"),
        (("--scale", "inf"), "--scale inf"),
        (("--scale", "nan"), "--scale nan"),
        (("--integrator", "RK45"), "--examples are integrated by DOP853, without stabilization"),
        (("--baumgarte", "0"), "without stabilization"),
        (("--projection", "1"), "without stabilization"),
        (("--formulation", "au,el"), "expected one for --examples"),
        (("--speeds", "1"), "sleigh has 2"),
    ],
)
def test_what_draws_cannot_do_is_bad_input_and_nothing_is_integrated(
    words, says, asked, monkeypatch, capsys
):
    assert code(monkeypatch, "sleigh", "--end", END, "--examples", "4", *words) == 2
    assert says in capsys.readouterr().err and not asked


LEVELS = {key: f.level for key, f in FORMULATIONS.items() if f.applies_to(Sleigh)}


@pytest.mark.parametrize(
    ("words", "keys", "how"),
    [
        ((), [*LEVELS], {"baumgarte": None, "projection": None, "u0": None}),
        (
            ("--baumgarte", "0"),
            [key for key, level in LEVELS.items() if level == "acceleration"],
            {"baumgarte": 0.0, "projection": None},
        ),
        (
            ("--projection", "0.25"),
            [key for key, level in LEVELS.items() if level == "acceleration"],
            {"baumgarte": None, "projection": 0.25},
        ),
        (("--projection", "0.25", "--formulation", "kane,el"), ["el", "kane"], {}),
        (
            ("--tolerance", "1e-5", "--max-steps", "9", "--formulation", "au"),
            ["au"],
            {"rtol": 1e-5, "atol": 1e-5, "max_steps": 9, "integrator": "DOP853"},
        ),
    ],
)
def test_motions_are_by_all_formulations_or_with_stabilization_by_those_that_it_is_for(
    words, keys, how, asked, monkeypatch
):
    assert code(monkeypatch, "sleigh", "--end", END, *words) == 0
    assert sorted(one.key for one in asked) == sorted(keys)
    assert 0 < len(keys) <= len(LEVELS) and set(LEVELS.values()) == {"acceleration", "velocity"}
    for one in asked:
        assert (type(one.scene), one.t_end) == (Sleigh, 0.5)
        assert {name: getattr(one, name) for name in how} == how


def test_the_scene_of_a_motion_is_the_paper_s_robot_unless_another_is_named(asked, monkeypatch):
    for words in ((), ("coil", "--links", "3"), ("--scene", "coil")):
        assert code(monkeypatch, *words, "--end", END, "--formulation", "kane") == 0
    scenes = [one.scene for one in asked]
    assert [one.links for one in scenes] == [7, 3, 7]
    assert np.array_equal(scenes[0].inertia, Snake.paper().inertia)
    assert not np.array_equal(scenes[0].wheel_angle, scenes[2].wheel_angle)


def test_the_end_as_the_last_word_is_accepted_until_the_next_release(asked, monkeypatch, capsys):
    for words in ((END,), ("coil", END)):
        assert code(monkeypatch, *words, "--formulation", "kane") == 0
        assert "simulate END is now simulate --end END" in capsys.readouterr().err
    assert [(one.scene.links, one.t_end) for one in asked] == [(7, 0.5), (7, 0.5)]


def test_a_motion_is_written_as_a_table(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["simulate", "four-bar-chain", "--end", "0.05", "--formulation", "au", "-o", "a.npz"]
    monkeypatch.setattr(sys, "argv", ["eomcheck", *words])
    with pytest.raises(SystemExit) as stop:
        cli._run()
    assert stop.value.code == 0
    assert "written: a.npz" in capsys.readouterr().out
    scene = FourBarChain.example()
    motion = eomcheck.simulate(scene, "au", 0.05, rtol=1e-9, atol=1e-9)
    with np.load("a.npz") as file:
        np.testing.assert_array_equal(file["t"], motion.times)
        for k, name in enumerate(scene.coordinate_names):
            np.testing.assert_array_equal(file[f"q[{name}]"], motion.q[:, k])
            np.testing.assert_array_equal(file[f"v[{name}]"], motion.v[:, k])
        for k, name in enumerate(scene.constraint_names):
            np.testing.assert_array_equal(file[f"multiplier[{name}]"], motion.multipliers[:, k])
            np.testing.assert_array_equal(
                file[f"residual[{name}]"], motion.constraint_residual[:, k]
            )
        np.testing.assert_array_equal(file["energy"], motion.energy)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-o", "a.csv"), "output = 'a.csv' holds one motion: expected one --formulation"),
        (("-o", "a.csv", "--formulation", "au,el"), "holds one motion"),
        (("-o", "a.txt", "--formulation", "au"), "expected a file .csv"),
        (("-o", "a.csv", "--examples", "2"), "--output"),
    ],
)
def test_a_file_for_a_motion_is_of_one_motion(words, message: str, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["eomcheck", "simulate", "sleigh", "--end", "0.01", *words])
    with pytest.raises(SystemExit) as stop:
        cli._run()
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


def test_accelerations_are_those_of_the_position_that_is_given(monkeypatch, capsys):
    def printed(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eomcheck", "acceleration", "chain-pendulum", *words])
        with pytest.raises(SystemExit) as stop:
            cli._run()
        out = capsys.readouterr()
        return int(stop.value.code or 0), out.out, out.err

    scene = ChainPendulum.example()
    q = [0.3, -0.2, 0.5]
    code, out, _ = printed("--q", "0.3,-0.2,0.5", "--formulation", "kane")
    assert code == 0
    vdot = eomcheck.acceleration(scene, "kane", q, np.zeros(3)).vdot
    assert f"{np.abs(vdot).max():.10g}" in out
    assert "accelerations at this position" in out
    assert "θ_1 = 0.3" in out
    assert "accelerations at its start" in printed("--formulation", "kane")[1]
    code, _, error = printed("--q", "0.3")
    assert code == 2
    assert "q [0.3]: chain-pendulum[3] has 3, expected so many numbers" in error
