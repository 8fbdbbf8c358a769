"""Discrepancies between eomcheck and a library at one state, and their known explanations.

A `Discrepancy` holds M, bias, gravity, forces and q̈ of both sides at one state. Each reason is a
function of it that yields an `Explanation` if the numbers show its pattern: damping left out, an
armature on the diagonal of M, a multiple of the gravity, a joint axis reversed, another velocity of
the free base, or bodies that a file describes in a way that libraries read differently.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from eomcheck.claims.confusions import Candidate, agreement_within, matching
from eomcheck.descriptions.elements import COORDINATES
from eomcheck.engines.file_engine import AXES, FREE, BaseVelocity, FreeBase, RobotDescription, few
from eomcheck.evaluation.tolerance import INCONCLUSIVE, largest
from eomcheck.numbers.generic import Array

CLOSE, ROUNDED = 1e-8, 1e-13
"""Relative differences below which values agree but for digits; and but for rounding."""

TERMS = "M", "bias", "gravity"


def relative_scale(entry: float, summed: float) -> float:
    """Return the scale of relative differences: the largest entry, or the terms that cancelled.

    Args:
        entry: the largest entry.
        summed: size of the terms that entries are summed from; it counts where these have cancelled
            to less than a thousandth of it.
    """
    return summed if entry < INCONCLUSIVE * summed else entry


class Discrepancy(NamedTuple):
    """The quantities of eomcheck and of a library at one state.

    Attributes:
        description: description of the robot in the file.
        joints: names of the coordinates.
        v: velocities (n,).
        reference: quantity -> value.
        library: quantity -> value.
        summed: quantity -> size of the terms that it is summed from, 0 where it is not known.
        free: motion of the frame that the library fixes to a free base, and the velocity that it
            is assumed to use for it; None where the base is held.
    """

    description: RobotDescription
    joints: tuple[str, ...]
    v: Array
    reference: dict[str, Array]
    library: dict[str, Array]
    summed: dict[str, float]
    free: tuple[FreeBase, BaseVelocity] | None = None

    def error(self, name: str) -> Array:
        """Return the difference library - reference of a quantity."""
        return self.library[name] - self.reference[name]

    def agrees_on(self, name: str, tolerance: float = CLOSE) -> bool:
        """Return whether both sides agree on a quantity to a relative tolerance."""
        scale = relative_scale(largest(self.reference[name]), self.summed.get(name, 0.0))
        return largest(self.error(name)) <= tolerance * max(scale, 1e-300)

    @property
    def terms_agree(self) -> bool:
        """Whether M, bias and gravity agree but for digits."""
        return all(self.agrees_on(name) for name in TERMS)

    @property
    def damped(self) -> list[int]:
        """Coordinates of joints with dampers."""
        several = tuple(COORDINATES["floating"] + COORDINATES["planar"])
        names = self.description.damped
        return [
            i
            for i, name in enumerate(self.joints)
            if name in names or (name.endswith(several) and name.rpartition("_")[0] in names)
        ]

    @property
    def leaves_out_damping(self) -> bool:
        """Whether the accelerations differ by the forces of dampers alone.

        M times the difference is then along the velocity, and nonzero at damped joints alone.
        """
        if (
            "q̈" not in self.reference
            or self.agrees_on("q̈")
            or not (self.damped and self.terms_agree)
        ):
            return False
        missing = self.reference["M"] @ self.error("q̈")
        others = np.delete(missing, self.damped)
        along = missing[self.damped] * self.v[self.damped] >= 0
        taken = largest(self.reference["forces"] - self.reference["gravity"])
        close = CLOSE * max(largest(self.reference["M"] @ self.reference["q̈"]), taken)
        return largest(others) <= close and bool(along.all())


class Explanation(NamedTuple):
    """An explanation of a difference.

    Attributes:
        sentence: the explanation.
        label: the same in a word or two, where it explains the whole difference; else "".
        of_quantities: whether conformance quantities may differ for that reason too.
    """

    sentence: str
    label: str = ""
    of_quantities: bool = True


# ---- Reasons -------------------------------------------------------------------------------------

Reason = Callable[[Discrepancy], Iterator[Explanation]]
_REASONS: list[Reason] = []


def _reason(function: Reason) -> Reason:
    _REASONS.append(function)
    return function


def explain(parting: Discrepancy) -> list[Explanation]:
    """Return the known explanations of a difference."""
    return [explanation for reason in _REASONS for explanation in reason(parting)]


@_reason
def _digits(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the explanation that terms agree to many digits."""
    if gap.terms_agree and not all(gap.agrees_on(name, ROUNDED) for name in TERMS):
        whole = all(gap.agrees_on(name) for name in gap.reference) or gap.leaves_out_damping
        sentence = "the same but for digits: more than doubles round, less than 1e-8"
        yield Explanation(sentence, "fewer digits" if whole else "")


@_reason
def _damping(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the explanation that the library ignores damping."""
    if gap.leaves_out_damping:
        sentence = f"leaves out the damping of {_joints(gap, gap.damped)}"
        yield Explanation(sentence, "no damping", of_quantities=False)  # they have weight alone


@_reason
def _armature(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the explanation that M differs on its diagonal alone."""
    if gap.agrees_on("M"):
        return
    error = gap.error("M")
    beside = error - np.diag(np.diagonal(error))
    if largest(beside) <= CLOSE * largest(gap.reference["M"]) and gap.agrees_on("bias"):
        rounding = ROUNDED * largest(gap.reference["M"])
        explained = np.maximum(rounding, CLOSE * np.abs(np.diagonal(gap.reference["M"])))
        where = [int(i) for i in np.flatnonzero(np.abs(np.diagonal(error)) > explained)]
        more = bool((np.diagonal(error)[where] > 0).all())
        adds = "adds to the diagonal of M alone, as an armature does"
        less = "has less on the diagonal of M alone, as without an armature"
        yield Explanation(f"{adds if more else less}: {_joints(gap, where)}")


@_reason
def _gravity(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the explanation that gravity is a multiple of the expected one."""
    expected, actual = gap.reference["gravity"], gap.library["gravity"]
    if gap.agrees_on("gravity") or not expected.any():
        return
    factor = float(expected @ actual / (expected @ expected))
    if largest(actual - factor * expected) <= CLOSE * largest(expected):
        yield Explanation(f"has {factor:.6g} times our gravity")


@_reason
def _axes(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the explanation that one or two joints have the opposite axis.

    M is the same if all other joints have it instead: gravity distinguishes the two, unless it
    vanishes.
    """
    if gap.agrees_on("M"):
        return
    n = len(gap.reference["M"])
    fitting = []
    for flipped in (i for count in (1, 2) for i in combinations(range(n), count)):
        signs = np.ones(n)
        signs[list(flipped)] = -1
        candidate = Candidate("opposite axis", np.outer(signs, signs) * gap.reference["M"])
        if _matching(gap, [candidate]):
            weight = gap.library["gravity"] - signs * gap.reference["gravity"]
            fitting.append((largest(weight) > CLOSE * largest(gap.reference["gravity"]), flipped))
    if fitting:
        _, flipped = min(fitting, key=lambda fit: fit[0])
        yield Explanation(f"has the opposite axis: {_joints(gap, list(flipped))}")


@_reason
def _base_frame(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the explanation that the velocity of a free base is along other axes than assumed."""
    if gap.free is None or gap.agrees_on("M"):
        return
    base, assumed = gap.free
    taken, _ = base.velocity(assumed, gap.v[:FREE])
    conventions = []
    for convention in map(BaseVelocity._make, product(AXES, AXES, (False, True))):
        T = np.eye(len(gap.v))
        T[:FREE, :FREE] = np.linalg.solve(base.velocity(convention, gap.v[:FREE])[0], taken)
        M = T.T @ gap.reference["M"] @ T
        conventions.append(Candidate(str(convention), M))
    fitting = _matching(gap, conventions)
    if len(fitting) == 1:  # without a rotation of the base, all axes are the same
        yield Explanation(f"has another velocity of the base: {fitting[0].text}, not {assumed}")


def _matching(gap: Discrepancy, candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates for M that agree with the library's, other than like the expected M."""
    agree = agreement_within(CLOSE * largest(gap.reference["M"]))
    return [*matching(gap.library["M"], gap.reference["M"], candidates, agree)]


ODD_LINKS = {
    "massless": "moments of inertia without mass ({}), which libraries may drop",
    "impossible": "inertias that no body can have ({}), which libraries may change",
    "empty": "links without inertia ({}), to which libraries may give some",
}
"""Attribute of a `RobotDescription` -> the sentence on its links."""


@_reason
def _odd_bodies(gap: Discrepancy) -> Iterator[Explanation]:
    """Yield the bodies of the file that libraries may read differently."""
    for links, sentence in ODD_LINKS.items():
        if (names := getattr(gap.description, links)) and not gap.agrees_on("M"):
            yield Explanation("the file has " + sentence.format(few(names)))


def _joints(gap: Discrepancy, indices: list[int]) -> str:
    return few([gap.joints[i] for i in indices])
