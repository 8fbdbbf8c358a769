"""SymPy: `sympy.physics.mechanics.System` of bodies and joints, by Kane's method, lambdified.

Equations are formed in symbols of the coordinates, with the numbers of the scene, when they are
first asked for; that takes seconds for a few joints in space, so that larger trees are not
represented (`MOST_JOINTS`). Equations that users derived themselves are checked by
`eomcheck.testing.from_kane` and `from_lagrange`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.errors import required
from eomcheck.numbers.generic import Array

MOST_JOINTS = 4
"""Largest number of joints of a tree that is represented."""


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Ignore that the velocity of a point can be derived along two paths, which are equal here."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"\s*Velocity of")
        yield


class SympyEngine(TreeEngine):
    """Tree of rigid bodies as a SymPy `System`."""

    key = "sympy"
    module, extra = "sympy.physics.mechanics", "sympy"
    oldest = "1.13"
    any_inertia = True

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether there are at most `MOST_JOINTS` joints, and no rotors."""
        return len(links) <= MOST_JOINTS and not any(link.armature for link in links)

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        with _without_warnings():
            self._assemble(library, links)

    def _assemble(self, library: Any, links: list[TreeLink]) -> None:
        self._sympy, self._mechanics = required("sympy"), library
        self._functions: dict[str, Callable[..., Any]] = {}
        names = range(self._n)
        self._q, self._u = (
            [library.dynamicsymbols(f"{letter}{i}") for i in names] for letter in "qu"
        )
        self._speeds = {x.diff(): u for x, u in zip(self._q, self._u, strict=True)}
        self._rates = [self._sympy.Dummy(f"a{i}") for i in names]
        self._weight = self._sympy.symbols("g_x g_y g_z")
        ground = library.RigidBody("ground")
        self._system = system = library.System.from_newtonian(ground)
        self._world, self._origin = ground.frame, ground.masscenter
        self._bodies, joints = [], []
        for i, link in enumerate(links):
            parent = self._bodies[link.parent] if link.parent >= 0 else ground
            before = links[link.parent].center if link.parent >= 0 else np.zeros(3)
            frame = library.ReferenceFrame(f"B{i}")
            center, seat = library.Point(f"C{i}"), library.ReferenceFrame(f"S{i}")
            seat.orient_explicit(parent.frame, self._matrix(link.rotation))
            entries = link.inertia[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
            moments = library.inertia(frame, *self._exact(entries))
            (mass,) = self._exact(link.mass)
            body = library.RigidBody(f"L{i}", center, frame, mass, (moments, center))
            kind = library.PrismaticJoint if link.slides else library.PinJoint
            joint = kind(
                f"J{i}",
                parent,
                body,
                self._q[i],
                self._u[i],
                # Vectors from the centre of mass.
                parent_point=self._vector(parent.frame, link.offset - before),
                child_point=-self._vector(frame, link.center),
                parent_interframe=seat,
                joint_axis=self._vector(seat, link.axis),
            )
            self._bodies.append(body)
            joints.append(joint)
        system.add_joints(*joints)
        system.apply_uniform_gravity(self._vector_of(self._world, self._weight))
        self._seats = {}
        for x in self.frames:
            if x.joint >= 0:
                body, frame = self._bodies[x.joint], library.ReferenceFrame(f"F_{x.name}")
                frame.orient_explicit(body.frame, self._matrix(x.R))
                arm = self._vector(body.frame, x.p - links[x.joint].center)
                point = body.masscenter.locatenew(f"O_{x.name}", arm)
                velocity = point.v2pt_theory(body.masscenter, self._world, body.frame)
                # Speeds for q̇, of which velocities of slides are made.
                point.set_vel(self._world, library.msubs(velocity, self._speeds))
                self._seats[x.name] = frame, point

    def _exact(self, values: Any) -> list[Any]:
        """Return numbers as SymPy's, row by row, whole ones as integers so that terms vanish."""
        numbers = np.asarray(values, np.float64).ravel().tolist()
        return [int(x) if x == int(x) else self._sympy.Float(x, 17) for x in numbers]

    def _matrix(self, R: Array) -> Any:
        return self._sympy.Matrix(3, 3, self._exact(R))

    def _vector(self, frame: Any, values: Array) -> Any:
        """Return a vector of numbers along the axes of a frame."""
        return self._vector_of(frame, self._exact(values))

    @staticmethod
    def _vector_of(frame: Any, entries: Any) -> Any:
        x, y, z = entries
        return x * frame.x + y * frame.y + z * frame.z

    def _in_world(self, vector: Any) -> Any:
        """Return the entries (3, 1) of a vector along the axes of the world."""
        return vector.to_matrix(self._world)

    def _value(
        self,
        name: str,
        expression: Callable[[], Any],
        q: Array,
        v: Array | None = None,
        vdot: Array | None = None,
        gravity: Array | None = None,
    ) -> Array:
        """Return the value of an expression, made and lambdified when it is first asked for.

        Args:
            name: its name, by which the function is kept.
            expression: function that makes it.
            q: coordinates (n,).
            v: speeds (n,), 0 unless given.
            vdot: their rates (n,), 0 unless given.
            gravity: acceleration of gravity (3,), 0 unless given.
        """
        if name not in self._functions:
            rates = {u.diff(): rate for u, rate in zip(self._u, self._rates, strict=True)}
            with _without_warnings():
                made = self._mechanics.msubs(self._sympy.Matrix(expression()), rates, self._speeds)
            arguments = self._q, self._u, self._rates, self._weight
            self._functions[name] = self._sympy.lambdify(arguments, made, "numpy", cse=True)
        zeros = np.zeros(self._n)
        state = (zeros if x is None else x for x in (v, vdot))
        weight = np.zeros(3) if gravity is None else gravity
        return np.array(self._functions[name](q, *state, weight), np.float64)

    def _equations(self) -> Any:
        """Return the sum Fr + Fr* of Kane's equations (n, 1), formed once."""
        if self._system.eom_method is None:
            self._formed = self._system.form_eoms()
        return self._formed

    def _mass_matrix(self) -> Any:
        self._equations()
        return self._system.mass_matrix

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n), the `mass_matrix` of the system."""
        return self._value("mass_matrix", self._mass_matrix, q)

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), minus Fr + Fr* of `form_eoms` at u̇ = 0, without gravity."""
        return -self._value("equations", self._equations, q, v).ravel()

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,), minus Fr + Fr* of `form_eoms`."""
        return -self._value("equations", self._equations, q, v, vdot, self._gravity).ravel()

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), minus Fr + Fr* of `form_eoms` at rest."""
        return -self._value("equations", self._equations, q, gravity=self._gravity).ravel()

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `kinetic_energy`."""

        def energy() -> Any:
            return [self._mechanics.kinetic_energy(self._world, *self._bodies)]

        return float(self._value("kinetic_energy", energy, q, v).item())

    def _center(self) -> Any:
        """Return the vector from the origin to the centre of mass."""
        functions = required("sympy.physics.mechanics.functions")
        return functions.center_of_mass(self._origin, *self._bodies)

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `center_of_mass`."""
        return self._value("center_of_mass", lambda: self._in_world(self._center()), q).ravel()

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `linear_momentum`, and `angular_momentum` about the centre of mass."""

        def momentum() -> Any:
            center = self._origin.locatenew("C", self._center())
            linear = self._mechanics.linear_momentum(self._world, *self._bodies)
            angular = self._mechanics.angular_momentum(center, self._world, *self._bodies)
            return self._in_world(linear).col_join(self._in_world(angular))

        return self._value("momentum", momentum, q, v).ravel()

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `dcm` and `pos_from`."""
        frame, point = self._seat(f)

        def placement() -> Any:
            position = self._in_world(point.pos_from(self._origin))
            return self._world.dcm(frame).row_join(position)

        whole = self._value(f"placement of {f}", placement, q)
        return whole[:, :3], whole[:, 3]

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `vel` and `ang_vel_in`."""
        frame, point = self._seat(f)

        def velocity() -> Any:
            linear = self._in_world(point.vel(self._world))
            return linear.col_join(self._in_world(frame.ang_vel_in(self._world)))

        return self._value(f"velocity of {f}", velocity, q, v).ravel()

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `partial_velocity` of the point and of the frame."""
        frame, point = self._seat(f)

        def jacobian() -> Any:
            parts = (x.partial_velocity(self._world, *self._u) for x in (point, frame))
            rows = [[self._in_world(x) for x in np.atleast_1d(part)] for part in parts]
            return self._sympy.Matrix.vstack(*(self._sympy.Matrix.hstack(*row) for row in rows))

        return self._value(f"jacobian of {f}", jacobian, q)

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) by `acc` and `ang_acc_in`."""
        frame, point = self._seat(f)

        def acceleration() -> Any:
            linear = self._in_world(point.acc(self._world))
            return linear.col_join(self._in_world(frame.ang_acc_in(self._world)))

        return self._value(f"acceleration of {f}", acceleration, q, v, vdot).ravel()

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,), the acceleration at u̇ = 0."""
        return self.frame_acceleration(f, q, v, np.zeros(self._n), t)
