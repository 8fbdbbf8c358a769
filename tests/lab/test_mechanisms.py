"""Pictures of scenes and matrices: all is named, no label covers another, all is what it says."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import eomcheck
from eomcheck.cli import main
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import assembly_error
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.chart_matplotlib import plt
from eomcheck.lab.show.pictures import (
    moving_state,
    posed_sketch,
    scene_and_pose,
    scene_figure,
    sketch_of,
    sketches_of_motion,
    structure_of,
)
from eomcheck.lab.show.sketch_drawing import DARK, LIGHT, symbol
from eomcheck.mechanics import sketch as s
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import FLOAT64
from eomcheck.numbers.linear import null_space
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import SCENES, Andrews, Bicycle, RollingDisk, Snake

PENDULUM = Path(__file__).parents[2] / "docs" / "guides" / "pendulum.py"
KINDS = [*SCENES.values(), *scene_classes_named(f"{PENDULUM}:Pendulum")]
each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.key)


def links_of(kind: type[Scene]) -> int | None:
    return 3 if kind.has_links else None


# ---- What is drawn -------------------------------------------------------------------------------


@each_kind
def test_every_coordinate_and_every_row_of_the_constraints_is_named_once(kind):
    scene, _ = kind.sketched(links_of(kind))
    sketch, names = posed_sketch(*scene_and_pose(kind, links_of(kind)))
    assert names == scene.coordinate_names
    named = [p.name for p in sketch.parts if isinstance(p, s.Angle | s.Distance)]
    assert [named.count(name) for name in names] == [1] * scene.n
    rows = [row for p in sketch.parts if isinstance(p, s.ConstraintMark) for row in p.rows]
    assert sorted(rows) == list(range(scene.r))


@pytest.mark.parametrize("kind", [SCENES["andrews"], Bicycle, KINDS[-1]], ids=lambda kind: kind.key)
def test_the_pose_that_is_drawn_is_closed(kind):
    """Each wants a pose that is not closed, and the one that is drawn is."""
    scene, wanted = kind.sketched()
    found = []
    monitored = type(scene).sketch

    def watched(self, q, t=0.0):
        found.append(q)
        return monitored(self, q, t)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, "sketch", watched)
        posed_sketch(*scene_and_pose(kind))
    (q,) = found
    at = Evaluation(scene, q, np.zeros(scene.n))
    gap, allowed = assembly_error(at)
    assert gap <= allowed
    assert 0 < np.abs(q - wanted).max() < 1.0


@each_kind
def test_centres_of_mass_move_as_the_scene_says(kind):
    """The sketch at q + h v: its centres move with V of the second derivation, where they are all
    drawn and V is along x, y, z."""
    scene, q = kind.sketched(links_of(kind))
    rng = np.random.default_rng(5)
    v, h = rng.standard_normal(scene.n), 1e-6

    def centers(at: np.ndarray) -> np.ndarray:
        sketch = sketch_of(scene, at)
        return np.array([p.at for p in sketch.parts if isinstance(p, s.Center)])

    here = scene.parameters(FLOAT64)
    V = scene.velocities(here, scene.prepare(FLOAT64, here, q, 0.0), q, v)[0]
    moved = (centers(q + h * v) - centers(q - h * v)) / (2 * h)
    if not len(moved):
        assert kind in (
            RollingDisk,
            *(SCENES[key] for key in ("turntable-ball", "flyball-governor")),
        ) or (kind.key == "pendulum")
        return
    # Bodies are listed in an order of their own.
    for one in moved:
        assert np.abs(V[:, : len(one)] - one).max(axis=1).min() < 1e-7


@pytest.mark.parametrize("kind", [SCENES["sleigh"], Snake], ids=lambda kind: kind.key)
def test_wheels_are_drawn_along_the_way_that_they_roll(kind):
    """Whatever velocity the constraints leave."""
    scene, q = kind.sketched(links_of(kind))
    free = null_space(Evaluation(scene, q, np.zeros(scene.n)).terms.a)

    def wheels(at: np.ndarray) -> list[s.Wheel]:
        return [p for p in sketch_of(scene, at).parts if isinstance(p, s.Wheel)]

    here, h = wheels(q), 1e-6
    assert len(here) == scene.r
    for v in free.T:
        for wheel, after, before in zip(here, wheels(q + h * v), wheels(q - h * v), strict=True):
            (x, y), (dx, dy) = wheel.along, (after.at - before.at) / (2 * h)
            assert abs(x * dy - y * dx) < 1e-8


def test_angles_of_the_disk_and_the_bicycle_turn_as_their_coordinates_do():
    """A spoke, an axle or a heading that an angle leads to moves by that coordinate as drawn."""
    for kind, name in ((RollingDisk, "φ"), (RollingDisk, "ψ"), (Bicycle, "θ"), (Bicycle, "φ")):
        scene, q = kind.sketched()
        i = scene.coordinate_names.index(name)

        def arm(at: np.ndarray, scene=scene, name=name) -> np.ndarray:
            parts = sketch_of(scene, at).parts
            (angle,) = [p for p in parts if isinstance(p, s.Angle) and p.name == name]
            return np.cos(angle.angle) * angle.first + np.sin(angle.angle) * angle.second

        step = np.zeros(scene.n)
        step[i] = 1e-6
        turned = (arm(q + step) - arm(q - step)) / 2e-6
        assert np.hypot.reduce(turned) == pytest.approx(1.0, abs=1e-6), (kind.key, name)


def test_the_bicycle_is_drawn_rolling_on_the_ground_at_its_speed():
    sketches, _, _ = sketches_of_motion(Bicycle.example(), "au", 0.5, 6)
    contacts = np.array([[p.at for p in one.parts if isinstance(p, s.Trail)] for one in sketches])
    assert np.abs(contacts[..., 2]).max() < 1e-6
    way = np.linalg.norm(np.diff(contacts, axis=0), axis=2).sum(axis=0)
    assert np.abs(way - 0.5 * 4.6).max() < 0.05  # m


# ---- How it is drawn -----------------------------------------------------------------------------


@pytest.mark.sampled(6)
@pytest.mark.parametrize("dark", [False, True])
@each_kind
def test_labels_cover_no_other_label_and_stay_on_the_page(kind, dark):
    figure, texts = scene_figure(*posed_sketch(*scene_and_pose(kind, links_of(kind))), dark)
    renderer = figure.canvas.get_renderer()
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in texts]
    page = figure.bbox
    plt.close(figure)
    for name, box in boxes:
        assert page.x0 <= box.x0 < box.x1 <= page.x1, name
        assert page.y0 <= box.y0 < box.y1 <= page.y1, name
    for (one, first), (other, second) in combinations(boxes, 2):
        apart = (
            first.x1 <= second.x0
            or second.x1 <= first.x0
            or first.y1 <= second.y0
            or second.y1 <= first.y0
        )
        assert apart, (one, other)


def luminance(color: str) -> float:
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("colors", [LIGHT, DARK])
def test_letters_stand_out_from_the_ground(colors):
    for name in ("ink", "coordinate", "constraint", "axis", "spring"):
        ground, letter = sorted((luminance(colors.ground), luminance(getattr(colors, name))))
        assert (letter + 0.05) / (ground + 0.05) > 4.5, name


def test_indices_are_written_below():
    assert symbol("β_f") == r"$\mathrm{β}_{\mathrm{f}}$"
    assert symbol("wheel 1") == "wheel 1"


def run(monkeypatch, *arguments) -> int:
    monkeypatch.setattr("sys.argv", ["eomcheck", "draw", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("key", SCENES)
def test_the_command_writes_every_scene_small_and_the_same_every_time(key, tmp_path, monkeypatch):
    links = ["--links", 2] if SCENES[key].has_links else []
    files = [tmp_path / name for name in ("a.svg", "b.svg")]
    for file in files:
        assert run(monkeypatch, "scene", file, "--scene", key, *links) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert files[0].stat().st_size < 100_000


def test_a_moving_picture_has_its_frames_and_moves(tmp_path, monkeypatch):
    path = tmp_path / "snake.gif"
    assert run(monkeypatch, "scene", path, "--end", 0.5, "--frames", 5) == 0
    with Image.open(path) as picture:
        assert picture.n_frames == 5
        first = np.asarray(picture.convert("RGB")).copy()
        picture.seek(4)
        assert (np.asarray(picture.convert("RGB")) != first).any(axis=2).mean() > 0.01


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("scene", "x.svg", "--scene", "all"), "'all': expected one scene"),
        (("scene", "x.svg", "--scene", "snak"), "snak"),
        (("scene", "x.svg", "--scene", "sleigh", "--links", 3), "--links 3"),
        (("scene", "x.txt"), "a figure is written as"),
        (("scene", "x.gif", "--dark"), "a .gif, which has a light ground"),
        (("scene", "x.gif", "--frames", 1), "--frames 1"),
        (("scene", "x.gif", "--end", -1), "-1"),
        (
            ("scene", "x.svg", "--scene", f"{PENDULUM.with_name('trailer.py')}:Trailer"),
            "no `sketch`",
        ),
        (("structure", "x.svg", "--formulation", "kan"), "kan"),
        (("structure", "x.svg", "--formulation", "banded", "--scene", "sleigh"), "does not apply"),
    ],
)
def test_bad_input_is_one_sentence(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *arguments) == 2
    error = capsys.readouterr().err
    assert says in error
    assert "Traceback" not in error
    assert not [*tmp_path.iterdir()]


def test_a_scene_without_a_sketch_is_named():
    class Plain(Andrews):
        key = "plain"

        def sketch(self, q, t=0.0):
            return None

    with pytest.raises(InputError, match="plain does not say what it looks like"):
        posed_sketch(*scene_and_pose(Plain))


# ---- Matrices ------------------------------------------------------------------------------------


def seven(key: str):
    return structure_of(*moving_state(*scene_and_pose(Snake, 7), FORMULATIONS[key]))


@pytest.mark.parametrize("key", FORMULATIONS)
def test_the_last_matrix_is_of_the_order_that_table_i_counts(key):
    f = FORMULATIONS[key]
    last = (*seven(key).read, *seven(key).solved)[-1]
    order = f.unknowns(9, 7, 14)
    if key == "gw":  # M itself, which is read
        assert order in {len(one.entries) for one in seven(key).read}
    else:
        assert last.entries.shape == (order, order)
        assert sum(size for _, size in last.columns) == order


@pytest.mark.parametrize("key", FORMULATIONS)
def test_matrices_are_those_that_doubles_solve(key):
    scene, f, q, v = moving_state(*scene_and_pose(Snake, 7), FORMULATIONS[key])
    structure = structure_of(scene, f, q, v)
    at = Evaluation(scene, q, v)
    at.acceleration(f)
    orders = {solve.name: solve.size for solve in at.solves[key, False].values()}
    for one in structure.solved:
        assert orders[one.name] == len(one.entries)
    assert {len(one.entries) for one in (*structure.read, *structure.solved)} >= {*orders.values()}


def test_blocks_are_named_by_what_they_are():
    names = {key: [b.name for one in seven(key).solved for b in one.blocks] for key in FORMULATIONS}
    assert [n for n in names["im"] if n] == ["I", "M", "-aᵀ", "-a"]
    assert [n for n in names["au"] if n] == ["M", "-aᵀ", "-a"]
    assert names["el"] == ["a′ᵀ", "wᵀ M", "a"]
    assert names["gw"] == ["a M⁻¹ aᵀ"]
    assert names["em"] == ["a₁", "wᵀ M w"]
    assert names["ml"] == names["kane"] == ["Wᵀ M W"]
    assert [n for n in names["banded"] if n][:6] == ["D", "-Aᵀ", "-A", "-C", "-Cᵀ", "D"]


def test_a_block_that_is_something_else_has_no_name(monkeypatch):
    scene, f, q, v = moving_state(*scene_and_pose(Snake, 7), FORMULATIONS["au"])

    def wrong(M, F, a, gamma, v, partition):
        from eomcheck.formulations import au
        from eomcheck.numbers.linear import solve

        system, right = au.system(M, F, 2 * a, gamma)
        return au.split(solve(system, right, "M_Au"), a)

    from dataclasses import replace

    (one,) = structure_of(scene, replace(f, solution=wrong), q, v).solved
    assert [block.name for block in one.blocks] == ["M", "", "", ""]


def test_without_constraints_one_matrix_is_read_and_solved():
    state = moving_state(*scene_and_pose(SCENES["chain-pendulum"], 4), FORMULATIONS["em"])
    structure = structure_of(*state)
    assert [one.name for one in structure.read] == ["M"]
    assert structure.solved == ()


@pytest.mark.parametrize("key", FORMULATIONS)
@pytest.mark.sampled(3)
def test_the_command_draws_every_formulation(key, tmp_path, monkeypatch):
    path = tmp_path / "a.svg"
    assert run(monkeypatch, "structure", path, "--formulation", key, "--links", 7) == 0
    assert 1000 < path.stat().st_size < 100_000


def test_every_page_of_a_scene_and_a_formulation_has_its_picture():
    docs = PENDULUM.parents[1]
    for folder, keys in (("scenes", SCENES), ("structure", eomcheck.FORMULATIONS)):
        for key in keys:
            page = docs / ("theory" if folder == "structure" else folder) / f"{key}.md"
            text = page.read_text(encoding="utf-8")
            for name in (f"{key}.svg", f"{key}-dark.svg"):
                assert f"../figures/{folder}/{name}" in text
                assert (docs / "figures" / folder / name).stat().st_size < 100_000
            if folder == "scenes":
                assert (docs / "figures" / folder / f"{key}.gif").stat().st_size < 300_000
