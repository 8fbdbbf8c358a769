"""Cosines and sines of many angles at once, the same bits in every lane and on every path.

The angle is reduced by a multiple of π/2 in three parts (Cody and Waite 1980), the first two so
short that their products with it are exact, and what the reduced angle loses by rounding is kept
beside it. Polynomials are those of fdlibm (Sun Microsystems 1993; `k_sin`, `k_cos`) with the
correction for that remainder. The error is below 1 ulp up to `REACH`; beyond it, for what is not
finite, and on a machine that cannot multiply and add at once, each angle goes to the C library.
"""

from __future__ import annotations

import math

from eomcheck.kernels.code import Code, real_type
from eomcheck.kernels.machine import features, has_sincos

REACH = 1e5
"""rad."""

AT_ONCE = 4
"""Angles of one state in a vector: wider ones cost more than they bring before they are full."""

PARTS = 1.5707963267341256e00, 6.0771005063039655e-11, 2.0222662487959506e-21
"""π/2: its first 33 bits, the next 33, and the 53 after these."""

SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COS = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)

TO_WHOLE = 1.5 * 2.0**52
"""A number of moderate size plus this is rounded to a whole one, in the last bits of the sum."""


def name_of(width: int) -> str:
    """Return the name of the function for `width` lanes."""
    return f"sincos_{width}"


def function(width: int) -> str:
    """Return the text of the function (x, address of cos x, address of sin x)."""
    code = Code(width)
    head = f"define internal void @{name_of(width)}({code.real} %x, ptr %cos, ptr %sin) nounwind"
    if not features()[2]:
        _by_library(code, "%x")
        return code.function(head)
    cos, sin = _reduced(code, "%x")
    code.store(cos, "%cos")
    code.store(sin, "%sin")
    within = code.compare("ole", code.call("fabs", "%x"), code.constant(REACH))
    beyond = code.let(f"xor {code.like('i1')} {within}, {code.splat_of('i1 true')}")
    with code.when(code.anywhere(beyond)):
        _by_library(code, "%x", beyond)
    return code.function(head)


def _reduced(code: Code, x: str) -> tuple[str, str]:
    """Return (cos x, sin x) of angles that are not too large."""

    def fma(x: str, y: str, z: str) -> str:
        return code.call("fma", x, y, z)

    def polynomial(z: str, coefficients: tuple[float, ...]) -> str:
        out = code.constant(coefficients[-1])
        for c in reversed(coefficients[:-1]):
            out = fma(out, z, code.constant(c))
        return out

    shifted = fma(x, code.constant(2 / math.pi), code.constant(TO_WHOLE))
    whole = code.let(f"bitcast {code.real} {shifted} to {code.like('i64')}")
    turns = code.sub(code.constant(TO_WHOLE), shifted)
    first = fma(turns, code.constant(PARTS[0]), x)
    step = code.mul(turns, code.constant(PARTS[1]))
    second = code.add(first, step)
    r = fma(turns, code.constant(PARTS[2]), second)
    # What the sum lost, whichever of the two was larger (Knuth), and what the last part left.
    back = code.sub(second, first)
    lost = code.add(code.sub(first, code.sub(second, back)), code.sub(step, back))
    y = code.add(fma(turns, code.constant(PARTS[2]), code.sub(second, r)), lost)

    z = code.mul(r, r)
    half = code.mul(code.constant(0.5), z)
    v = code.mul(z, r)
    tail = polynomial(z, SIN[1:])
    inner = code.sub(code.mul(code.constant(0.5), y), code.mul(v, tail))
    correction = code.sub(fma(z, inner, code.neg(y)), code.mul(v, code.constant(SIN[0])))
    sin = code.sub(r, correction)
    w = code.sub(code.constant(1.0), half)
    lost = code.sub(code.sub(code.constant(1.0), w), half)
    curve = code.mul(z, polynomial(z, COS))
    cos = code.add(w, code.add(lost, fma(z, curve, code.neg(code.mul(r, y)))))

    def flag(bits: str, mask: int) -> str:
        kind = code.like("i64")
        masked = code.let(f"and {kind} {bits}, {code.splat_of(f'i64 {mask}')}")
        return code.let(f"icmp ne {kind} {masked}, {code.splat_of('i64 0')}")

    odd = flag(whole, 1)
    after = code.let(f"add {code.like('i64')} {whole}, {code.splat_of('i64 1')}")
    c, s = code.choose(odd, sin, cos), code.choose(odd, cos, sin)
    return (
        code.choose(flag(after, 2), code.neg(c), c),
        code.choose(flag(whole, 2), code.neg(s), s),
    )


def _by_library(code: Code, x: str, where: str | None = None) -> None:
    """Write what the C library says over the lanes `where` a condition holds, by default all."""
    for lane in range(code.width):
        angle = code.lane(x, lane)
        cos, sin = code.at("%cos", lane, "double"), code.at("%sin", lane, "double")
        if where is None:
            library_call(code, angle, cos, sin)
            continue
        here = where if code.width == 1 else code.lane_of_condition(where, lane)
        with code.when(here):
            library_call(code, angle, cos, sin)


def library_call(code: Code, angle: str, cos: str, sin: str) -> None:
    """Write the cosine and sine of an angle, by the C library, to two addresses."""
    if has_sincos():
        code.do(f"call void @sincos(double {angle}, ptr {sin}, ptr {cos})")
        return
    for name, place in (("sin", sin), ("cos", cos)):
        code.do(f"store double {code.let(f'call double @{name}(double {angle})')}, ptr {place}")


def of_values(code: Code, x: list[str]) -> list[str]:
    """Return the cosines, then the sines, of a few values."""
    width = code.width if code.width > 1 or len(x) == 1 else AT_ONCE
    kind, step, cos, sin = real_type(width), 1 if width == code.width else width, [], []
    for first in range(0, len(x), step):
        some = x[first : first + step]
        angles = some[0]
        if width > code.width:
            angles = "zeroinitializer"
            for i, angle in enumerate(some):
                angles = code.let(f"insertelement {kind} {angles}, double {angle}, i64 {i}")
        code.do(f"call void @{name_of(width)}({kind} {angles}, ptr %cos_room, ptr %sin_room)")
        cos += [code.load("%cos_room", i) for i in range(len(some))]
        sin += [code.load("%sin_room", i) for i in range(len(some))]
    return cos + sin


def room(count: int) -> int:
    """Return how many numbers `write` writes for `count` angles: whole vectors."""
    return -(-count // AT_ONCE) * AT_ONCE


def write(code: Code, x: str, cos: str, sin: str, count: int) -> None:
    """Write the cosines and sines of `count` numbers at x to the addresses `cos` and `sin`."""
    if code.width > 1:
        with code.loop(count) as turn:
            angle = code.load(x, turn.i)
            places = f"ptr {code.at(cos, turn.i)}, ptr {code.at(sin, turn.i)}"
            code.do(f"call void @{name_of(code.width)}({code.real} {angle}, {places})")
        return
    wide = code.wider(AT_ONCE)
    full, left = divmod(count, AT_ONCE)
    if full:
        with code.loop(full) as turn:
            at = code.integer("mul", turn.i, AT_ONCE)
            places = f"ptr {code.at(cos, at)}, ptr {code.at(sin, at)}"
            angles = wide.load(code.at(x, at))
            code.do(f"call void @{name_of(AT_ONCE)}({wide.real} {angles}, {places})")
    if left:
        first, angles = full * AT_ONCE, "zeroinitializer"
        for i in range(left):  # nothing past the end is read
            angle = code.load(x, first + i)
            angles = code.let(f"insertelement {wide.real} {angles}, double {angle}, i64 {i}")
        places = f"ptr {code.at(cos, first)}, ptr {code.at(sin, first)}"
        code.do(f"call void @{name_of(AT_ONCE)}({wide.real} {angles}, {places})")
