"""Tree model of a scene: the plan of its bodies, their numbers, and the frames of its links.

A mechanism and a described scene have a plan of their own, with which every scalar type works. That
of any other scene follows from its `Scene.tree()`, in the coordinates x = T q + shift of its
joints, and has the numbers of that: those of the scene's parameters, where its `tree` takes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.described_scene import Described, parse_description
from eomcheck.descriptions.first_derivation import PreparedMechanism
from eomcheck.descriptions.joint_tree import ScalarJoint, Topology, TopologyPlan, plan_of
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.tree_quantities import (
    LinkNumbers,
    make_center_of_mass,
    make_coriolis_matrix,
    make_inverse_dynamics,
    make_link_motions,
    make_momentum,
    make_regressor,
    make_weight,
)
from eomcheck.descriptions.vector_algebra import rotation_matrices
from eomcheck.mechanics.records import Tree
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import FLOAT64, Angles, Arithmetic, Array, generic


class TreeNumbers(NamedTuple):
    """Numbers of the plan of a `Tree`."""

    mass: Any
    inertia: Any
    center: Any
    offset: Any
    rotation: Any
    gravity: Any


@dataclass(frozen=True, eq=False)
class TreeModel:
    """Bodies of a scene as a tree of scalar joints.

    Attributes:
        plan: plan of its bodies, without constraints.
        links: names of its links with a frame.
        joints: scalar joint of each link, -1 for the ground.
        frames: frames of the links on their scalar joints, in float64.
        description: function of the parameters that returns the `Description`, of a described
            scene; otherwise None.
        tree: the tree in float64, where the scene has no plan of its own; otherwise None.
        tilted: whether it is in the plane and its bodies have momentum about axes in the plane,
            which its numbers leave out.
    """

    plan: TopologyPlan
    links: tuple[str, ...]
    joints: tuple[int, ...]
    frames: LinkNumbers
    description: Callable[..., Any] | None = None
    tree: Tree | None = None
    tilted: bool = False

    @cached_property
    def body_links(self) -> tuple[int, ...]:
        """Indices of the links of bodies: of each scalar joint that carries one, the first."""
        first: dict[int, int] = {}
        for place, joint in enumerate(self.joints):
            first.setdefault(joint, place)
        return tuple(sorted(first[k] for k in self.plan.carriers if k in first))

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the links of bodies, in the order of the parameters of a regressor."""
        return tuple(self.links[place] for place in self.body_links)

    def function(self, name: str) -> Callable[..., Any]:
        """Return a generic function of this model, the same one for equal models.

        Its arguments are parameters, prepared values, v and, where it needs them, v̇ and the numbers
        of links (`LinkNumbers`).

        Args:
            name: "center_of_mass", "momentum", "weight", "link_motions", "coriolis_matrix",
                "inverse_dynamics" or "regressor".
        """
        carriers = {k: b for b, k in enumerate(self.plan.carriers)}
        bodies = tuple(carriers[self.joints[place]] for place in self.body_links)
        links = {"link_motions": self.joints, "regressor": bodies}.get(name)
        return _function(self.plan, self.description, name, links)


MAKERS: dict[str, Callable[..., Callable[..., Any]]] = {
    "center_of_mass": make_center_of_mass,
    "momentum": make_momentum,
    "weight": make_weight,
    "link_motions": make_link_motions,
    "coriolis_matrix": make_coriolis_matrix,
    "inverse_dynamics": make_inverse_dynamics,
    "regressor": make_regressor,
}


@lru_cache(4096)
def _function(
    plan: TopologyPlan,
    description: Callable[..., Any] | None,
    name: str,
    links: tuple[int, ...] | None,
) -> Callable[..., Any]:
    function = MAKERS[name](plan) if links is None else MAKERS[name](plan, links)
    if description is None:
        return generic(function)

    def described(parameters, *arguments):
        return function(parse_description(description, parameters).parameters, *arguments)

    described.__name__ = described.__qualname__ = name
    return generic(described)


def tree_model(scene: Scene) -> TreeModel | None:
    """Return the model of a scene's tree of bodies; None for a scene without a tree.

    It is that of `Scene.tree()` too where a class overrides the one that follows from its plan.
    """
    return scene.cached(_model_of)


def _model_of(scene: Scene) -> TreeModel | None:
    tree = scene.tree()
    if tree is None:
        return None
    links = tree.frames
    frames = LinkNumbers(
        np.array([x.R for x in links], np.float64).reshape(-1, 3, 3),
        np.array([x.p for x in links], np.float64).reshape(-1, 3),
    )
    parts = tuple(x.name for x in links), tuple(x.joint for x in links), frames
    if type(scene).tree is Mechanism.tree and isinstance(scene, Mechanism):
        return TreeModel(scene.plan.without_constraints, *parts, tilted=scene.source.tilted)
    if type(scene).tree is Described.tree and isinstance(scene, Described):
        description = type(scene).description
        plan = parse_description(description, scene.float64_parameters).plan
        return TreeModel(plan.without_constraints, *parts, description)
    return TreeModel(plan_of(_topology_of(tree)), *parts, tree=tree)


def _topology_of(tree: Tree) -> Topology:
    """Return the topology of a tree, each scalar joint with its own coordinate."""
    joints, bodies, rotors = [], 0, 0
    for k, (parent, kind) in enumerate(zip(tree.parent, tree.joint, strict=True)):
        heavy = bool(tree.mass[k] > 0 or np.any(tree.inertia[k]))
        gimbal = bool(np.any(tree.gimbal_armature[k : k + 1]))
        rotor = gimbal or bool(tree.armature[k])
        joints.append(
            ScalarJoint(
                parent,
                kind,
                coordinate=k,
                orientation=k,
                offset=k,
                body=bodies if heavy else None,
                rotor=rotors if rotor else None,
                gimbal=gimbal,
                name=tree.name[k],
            )
        )
        bodies, rotors = bodies + heavy, rotors + rotor
    return Topology(tuple(joints), tree.name)


# ---- Numbers -------------------------------------------------------------------------------------


def exact_tree(scene: Scene, parameters: Any) -> Tree | None:
    """Return the tree of a scene in the numbers of its parameters; None if it is float64 alone."""
    if len(signature(scene.tree).parameters) == 0:
        return None
    return scene.tree(parameters)


def _whole_or(arithmetic: Arithmetic, x: Array) -> Array:
    """Return numbers of `arithmetic`, whole ones as literals; exact numbers as they are."""
    whole = np.asarray(x)
    if whole.dtype == object:
        return whole
    numbers, nearest = np.array(arithmetic.numbers(whole), object), np.rint(whole)
    numbers[nearest == whole] = nearest[nearest == whole].astype(int)
    return numbers


def exact_tree_numbers(model: TreeModel, tree: Tree, arithmetic: Arithmetic) -> TreeNumbers:
    """Return the numbers of a `Tree` in exact numbers, whose float64 entries are constants."""
    carriers, rotors = list(model.plan.carriers), list(model.plan.rotors)
    parts = (tree.mass, tree.center, tree.inertia, tree.offset, tree.rotation)
    parts = (_whole_or(arithmetic, x) for x in (*parts, tree.gravity))
    mass, center, inertia, offset, rotation, gravity = parts
    turning = _whole_or(arithmetic, _rotor_inertia(model, tree))
    moments = np.concatenate((inertia[carriers], turning))
    masses = np.concatenate((mass[carriers], np.zeros(len(rotors), object)))
    own = (_none_where_zero(x) for x in (moments, center[carriers], offset, rotation))
    inertia, center, offset, rotation = own
    return TreeNumbers(masses, inertia, center, offset, rotation, gravity)


def _none_where_zero(x: Array) -> Array:
    """Return exact numbers with None, an absent term, in place of literals that are 0."""
    entries = [None if _is_literal(entry, 0) else entry for entry in x.flat]
    absent = np.empty(x.size, object)
    absent[:] = entries
    return absent.reshape(x.shape)


def _rotor_inertia(model: TreeModel, tree: Tree) -> Array:
    """Return the inertia (n_r, 3, 3) of rotors: about z, of gimbals about all axes."""
    rotors = model.plan.rotors
    armature = np.asarray(tree.armature)
    inertia = np.zeros((len(rotors), 3, 3), armature.dtype)
    for b, k in enumerate(rotors):
        if model.plan.joints[k].gimbal:
            inertia[b] = np.eye(3, dtype=int) * tree.gimbal_armature[k]
        else:
            inertia[b, 2, 2] = armature[k]
    return inertia


def tree_numbers(model: TreeModel, arithmetic: Arithmetic) -> TreeNumbers:
    """Return the numbers of a model that has a `Tree`, in those of `arithmetic`.

    They are variables if it creates such: rotations that are still orthogonal and inertias that are
    still symmetric, so that identities hold for all trees of this topology.
    """
    tree, plan = model.tree, model.plan
    assert tree is not None
    carriers, rotors = list(plan.carriers), list(plan.rotors)
    inertia = np.zeros((len(carriers) + len(rotors), 3, 3))
    inertia[: len(carriers)] = np.asarray(tree.inertia)[carriers]
    inertia[len(carriers) :] = _rotor_inertia(model, tree)
    mass = np.r_[np.asarray(tree.mass)[carriers], np.zeros(len(rotors))]
    center = np.asarray(tree.center)[carriers]
    if arithmetic is FLOAT64:
        return TreeNumbers(mass, inertia, center, tree.offset, tree.rotation, tree.gravity)
    moments = arithmetic.numbers(inertia)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        moments[:, j, i] = moments[:, i, j]
    parts = (arithmetic.numbers(np.asarray(x)) for x in (mass, center, tree.offset, tree.gravity))
    mass, center, offset, gravity = parts
    rotation = rotations_in(arithmetic, np.asarray(tree.rotation))
    return TreeNumbers(mass, moments, center, offset, rotation, gravity)


def rotations_in(arithmetic: Arithmetic, R: Array) -> Array:
    """Return rotations (k, 3, 3) in the numbers of `arithmetic`, any ones if it has variables."""
    if (np.rint(R) == R).all():
        return R.astype(int).astype(object)
    if hasattr(arithmetic, "vector"):
        return rotation_matrices(arithmetic.numbers(np.ones((len(R), 4))))
    return arithmetic.numbers(R)


def joint_coordinates(tree: Tree, arithmetic: Arithmetic) -> tuple[Array, Array]:
    """Return T (n_j, n) and shift (n_j,) of x = T q + shift, whole numbers as literals."""
    if arithmetic is FLOAT64:
        return tree.coordinates, tree.shift
    return _whole_or(arithmetic, tree.coordinates), _whole_or(arithmetic, tree.shift)


def joint_positions(
    model: TreeModel,
    arithmetic: Arithmetic,
    x: Array,
    angles: Angles | None = None,
) -> PreparedMechanism:
    """Return the joint coordinates of a model that has a `Tree`, and their angles.

    Args:
        model: the model.
        arithmetic: source of the angles.
        x: joint coordinates (n_j,).
        angles: angles of the hinges, if they are known.
    """
    hinges = list(model.plan.hinges)
    if hinges and angles is None:
        angles = arithmetic.angles(x[hinges])
    return PreparedMechanism(x, angles, None)


def summed_angles(
    model: TreeModel, T: Array, shift: Array, q: Array, known: Iterable[Angles]
) -> Angles | None:
    """Return the angles of the hinges as sums of known ones, by the addition theorems.

    In exact numbers an angle is a point of the circle: its sine does not follow from its value.

    Args:
        model: a model that has a `Tree`.
        T: matrix from q to the joint coordinates (n_j, n).
        shift: constant part of these (n_j,).
        q: coordinates (n,).
        known: angles, of which those whose values are coordinates are used.

    Returns:
        The angles; None where a coordinate has no known angle, or a sum is not one of whole
        multiples.
    """
    points = {
        id(value): (cos, sin)
        for angles in known
        for value, cos, sin in zip(angles.value, angles.cos, angles.sin, strict=True)
    }
    cosines, sines = [], []
    for k in model.plan.hinges:
        summands = [(j, factor) for j, factor in enumerate(T[k]) if not _is_literal(factor, 0)]
        whole = all(isinstance(factor, int) for _, factor in summands)
        if not (whole and _is_literal(shift[k], 0)):
            return None
        cosine, sine = 1, 0
        for j, factor in summands:
            if id(q[j]) not in points:
                return None
            cos, sin = points[id(q[j])]
            for _ in range(abs(factor)):
                turned = sin if factor > 0 else -sin
                cosine, sine = cosine * cos - sine * turned, sine * cos + cosine * turned
        cosines.append(cosine)
        sines.append(sine)
    x, hinges = T @ q + shift, list(model.plan.hinges)
    return Angles(x[hinges], np.array(cosines, object), np.array(sines, object))


def _is_literal(x: Any, value: int) -> bool:
    return isinstance(x, int) and x == value


def position_rates(
    model: TreeModel, positions: PreparedMechanism, rates: Array
) -> PreparedMechanism:
    """Return the rates of joint coordinates and their angles, from those of the coordinates."""
    angles, hinges = positions.angles, list(model.plan.hinges)
    if angles is None:
        return PreparedMechanism(rates, None, None)
    turning = rates[hinges]
    return PreparedMechanism(
        rates, Angles(turning, -angles.sin * turning, angles.cos * turning), None
    )


def link_numbers(model: TreeModel, arithmetic: Arithmetic) -> LinkNumbers:
    """Return the frames of the links on their scalar joints, in numbers of `arithmetic`."""
    rotation, offset = model.frames
    if arithmetic is FLOAT64:
        return model.frames
    return LinkNumbers(rotations_in(arithmetic, rotation), arithmetic.numbers(offset))
