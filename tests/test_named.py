"""Names of scenes: what each stands for, and the whole sentence where it stands for none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.scene_lookup import (
    ROBOTS,
    robot_file_warnings,
    scene_class_named,
    scene_classes_named,
    scene_named,
)
from eomcheck.scenes import SCENES, Sleigh, Snake


def test_all_kinds_are_those_of_the_registry_and_not_the_random_ones():
    assert scene_classes_named("all") == tuple(SCENES.values())
    assert scene_classes_named("sleigh") == (Sleigh,)
    for key, kind in RANDOM.items():
        assert scene_classes_named(key) == (kind,) and kind not in scene_classes_named("all")


def test_single_snakes_have_seven_links_unless_asked_and_that_of_the_paper_has_no_others():
    assert tuple(ROBOTS) == ("paper", "coil", "pattern")
    assert all(scene_class_named(name) is Snake for name in ROBOTS)
    for name, snake in (
        ("paper", Snake.paper()),
        ("coil", Snake.coil(7)),
        ("pattern", Snake.pattern(7)),
    ):
        assert repr(scene_named(name)) == repr(snake)
    assert repr(scene_named("coil", 3)) == repr(Snake.coil(3))
    assert repr(scene_named("pattern", 2)) == repr(Snake.pattern(2))
    assert repr(Snake.coil(3)) != repr(Snake.pattern(3))


def test_a_scene_of_a_kind_is_its_example_or_the_first_with_so_many_links():
    assert repr(scene_named("snake")) == repr(Snake.example())
    assert repr(scene_named("snake", 4)) == repr(next(Snake.structures(4)))
    scene: Any = scene_named("sleigh", None, {"mass": [2.5], "offset": [0.25]})
    assert (scene.mass, scene.offset, scene.inertia) == (2.5, 0.25, Sleigh.example().inertia)
    heavy: Any = scene_named("coil", 2, {"mass": [3.0]})
    assert heavy.mass.tolist() == [3.0, 3.0]


@pytest.mark.parametrize(
    ("look_up", "message"),
    [
        (
            lambda: scene_named("paper", 7),
            "links = 7: the robot of the paper has 7; coil has any",
        ),
        (
            lambda: scene_classes_named("coil"),
            "scene = 'coil' is a single snake, expected a kind such as 'snake'",
        ),
        (lambda: scene_class_named("all"), "scene = 'all': expected one scene"),
        (
            lambda: scene_classes_named("arm.usd:floating"),
            "scene = 'arm.usd:floating': only the root of a robot in a .urdf or .sdf can be set "
            "free",
        ),
    ],
)
def test_a_name_that_stands_for_nothing_here_is_refused_in_a_sentence(look_up, message):
    with pytest.raises(InputError) as error:
        look_up()
    assert str(error.value) == message


def test_names_that_are_known_are_told_with_single_snakes_where_one_may_be_meant():
    with pytest.raises(UnknownNameError) as of_kinds:
        scene_classes_named("worm")
    with pytest.raises(UnknownNameError) as of_one:
        scene_class_named("worm")
    assert set(of_one.value.known) - set(of_kinds.value.known) == {"paper", "coil", "pattern"}
    assert set(of_kinds.value.known) >= {*SCENES, *RANDOM}
    assert str(of_one.value).startswith("unknown scene 'worm'; known: snake, ")


def test_what_is_left_out_of_files_is_told_before_what_is_doubtful_and_of_each_file():
    def kind(**made: str) -> Any:
        usual = {"file": "arm.urdf", "ignored": "", "warnings": ""}
        return SimpleNamespace(source=SimpleNamespace(**usual | made))

    kinds = [
        kind(ignored="a mesh", warnings="a mass"),
        Sleigh,
        kind(file="leg.urdf", warnings="a name"),
        kind(),
    ]
    assert [*robot_file_warnings(kinds)] == [
        "arm.urdf: a mesh",
        "arm.urdf: a mass",
        "leg.urdf: a name",
    ]
