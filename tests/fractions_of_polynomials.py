"""Quotients of polynomials, exactly, beside the `Bound` that is stated about each of them.

A `Bound` says of a quantity x: 2^twos · g_1^e_1 g_2^e_2 ... · x is a polynomial with integer
coefficients, of at most that degree and with at most that sum of coefficients. `Pair` carries x
itself along, knows every divisor g by the object that was divided by, and so can form the very
polynomial that the bound is about.
"""

from __future__ import annotations

import math

import flint
import numpy as np

from eomcheck.numbers.finite_field import Bound, DegreeArithmetic, Denominator
from eomcheck.numbers.linear import solve

NAMES = ("x", "y", "z")
CONTEXT = flint.fmpz_mpoly_ctx.get(NAMES, "degrevlex")
Polynomial = flint.fmpz_mpoly


def polynomial(value: int) -> Polynomial:
    return CONTEXT.constant(value)


class Quotient:
    """p / q in lowest terms."""

    __slots__ = ("p", "q")

    def __init__(self, p: Polynomial, q: Polynomial | None = None):
        q = polynomial(1) if q is None else q
        if q == 0:
            raise ZeroDivisionError
        divisor = p.gcd(q)
        self.p, self.q = p // divisor, q // divisor

    def __add__(self, other: Quotient) -> Quotient:
        return Quotient(self.p * other.q + other.p * self.q, self.q * other.q)

    def __neg__(self) -> Quotient:
        return Quotient(-self.p, self.q)

    def __mul__(self, other: Quotient) -> Quotient:
        return Quotient(self.p * other.p, self.q * other.q)

    def __truediv__(self, other: Quotient) -> Quotient:
        return Quotient(self.p * other.q, self.q * other.p)


class Known:
    """The polynomial behind every divisor of the bounds of one computation."""

    def __init__(self):
        self.polynomials: dict[Bound, Polynomial] = {}

    def denominator(self, denominator: Denominator, twos: int) -> Polynomial:
        product = polynomial(2**twos)
        for g, power in denominator.factors.items():
            product *= self.polynomials[g] ** power
        return product


class Pair:
    """A quantity, and the bound that is stated about it."""

    __slots__ = ("bound", "exact", "known")

    def __init__(self, exact: Quotient, bound: Bound, known: Known):
        self.exact, self.bound, self.known = exact, bound, known

    def numerator(self) -> Polynomial:
        """Return the polynomial that the bound is about; it fails if there is none."""
        scaled = self.exact * Quotient(
            self.known.denominator(self.bound.denominator, self.bound.twos)
        )
        assert scaled.q == 1 or scaled.q == -1, f"{scaled.q} is not in the bound's denominator"
        return scaled.p * scaled.q

    def check(self) -> None:
        """Check what the bound says."""
        numerator, bound = self.numerator(), self.bound
        assert total_degree(numerator) <= bound.degree
        assert log_sum_of_coefficients(numerator) <= bound.height + 1e-9
        assert total_degree(self.exact.p) <= bound.degree

    def _with(self, bound: Bound | int, exact: Quotient) -> Pair | int:
        if isinstance(bound, int):
            assert exact.p == bound == 0
            return 0
        return Pair(exact, bound, self.known)

    def __add__(self, other: Pair | int) -> Pair | int:
        return self._with(self.bound + bound_of(other), self.exact + exact_of(other))

    def __radd__(self, other: int) -> Pair | int:
        return self._with(other + self.bound, self.exact + exact_of(other))

    def __neg__(self) -> Pair | int:
        return self._with(-self.bound, -self.exact)

    def __sub__(self, other: Pair | int) -> Pair | int:
        return self._with(self.bound - bound_of(other), self.exact + -exact_of(other))

    def __rsub__(self, other: int) -> Pair | int:
        return self._with(other - self.bound, exact_of(other) + -self.exact)

    def __mul__(self, other: Pair | int) -> Pair | int:
        return self._with(self.bound * bound_of(other), self.exact * exact_of(other))

    def __rmul__(self, other: int) -> Pair | int:
        return self._with(other * self.bound, self.exact * exact_of(other))

    def __truediv__(self, other: Pair | int) -> Pair | int:
        exact = self.exact / exact_of(other)
        if isinstance(other, Pair):
            self.known.polynomials[other.bound] = other.numerator()
        return self._with(self.bound / bound_of(other), exact)

    def __rtruediv__(self, other: int) -> Pair | int:
        exact = exact_of(other) / self.exact
        self.known.polynomials[self.bound] = self.numerator()
        return self._with(other / self.bound, exact)


def bound_of(x: Pair | int) -> Bound | int:
    return x.bound if isinstance(x, Pair) else x


def exact_of(x: Pair | int) -> Quotient:
    return x.exact if isinstance(x, Pair) else Quotient(polynomial(x))


def variables() -> list[Pair]:
    """Return the variables of a new computation."""
    known = Known()
    bounds = DegreeArithmetic().vector(len(NAMES))
    return [Pair(Quotient(x), b, known) for x, b in zip(CONTEXT.gens(), bounds, strict=True)]


def total_degree(p: Polynomial) -> int:
    return -1 if p == 0 else int(p.total_degree())


def log_sum_of_coefficients(p: Polynomial) -> float:
    total = sum(abs(int(c)) for c in p.coeffs())
    return math.log2(total) if total else -math.inf


# ---- Systems -------------------------------------------------------------------------------------


def determinant(A: list[list[Quotient]]) -> Quotient:
    """Return the determinant, expanded along the first row."""
    if not A:
        return exact_of(1)
    total = exact_of(0)
    for j, entry in enumerate(A[0]):
        if entry.p != 0:
            minor = determinant([row[:j] + row[j + 1 :] for row in A[1:]])
            total = total + (entry * minor if j % 2 == 0 else -(entry * minor))
    return total


def solve_pairs(A: list[list[Pair | int]], b: list[Pair | int], known: Known) -> list[Pair | int]:
    """Solve A x = b both ways: bounds by `solve`, the quantities by Cramer's rule.

    Raises:
        ZeroDivisionError: A is singular.
    """
    size = len(A)
    exact = [[exact_of(x) for x in row] for row in A]
    right = [exact_of(x) for x in b]
    whole = determinant(exact)
    if whole.p == 0:
        raise ZeroDivisionError
    bounds = np.array([[bound_of(x) for x in row] for row in A], object)
    solved = solve(bounds, np.array([bound_of(x) for x in b], object), "A")
    _learn_determinant(bounds, solved, whole, known)
    x: list[Pair | int] = []
    for i in range(size):
        replaced = [[*row[:i], y, *row[i + 1 :]] for row, y in zip(exact, right, strict=True)]
        value = determinant(replaced) / whole
        if isinstance(solved[i], Bound):
            x.append(Pair(value, solved[i], known))
        else:
            assert value.p == 0
            assert solved[i] == 0
            x.append(0)
    return x


def _learn_determinant(A: np.ndarray, x: np.ndarray, whole: Quotient, known: Known) -> None:
    """Find the one new divisor: the determinant, each row times its common denominator."""
    new = {g for y in x if isinstance(y, Bound) for g in y.denominator.factors}
    new -= known.polynomials.keys()
    if not new:
        return
    (divisor,) = new
    for row in A:
        powers: dict[Bound, int] = {}
        for entry in row:
            if isinstance(entry, Bound):
                for g, power in entry.denominator.factors.items():
                    powers[g] = max(powers.get(g, 0), power)
        twos = max((entry.twos for entry in row if isinstance(entry, Bound)), default=0)
        whole = whole * Quotient(known.denominator(Denominator(powers), twos))
    assert whole.q == 1 or whole.q == -1
    known.polynomials[divisor] = whole.p * whole.q
    assert total_degree(known.polynomials[divisor]) <= divisor.degree
    assert log_sum_of_coefficients(known.polynomials[divisor]) <= divisor.height + 1e-9
