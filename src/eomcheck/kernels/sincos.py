"""Sines and cosines of many angles at once, with the same bits in every lane and on every path.

The angle is reduced by a multiple of π/2 in three parts (Cody and Waite 1980), the first two so
short that their products with the multiple are exact, and the rounding error of the reduced angle
is computed too. Polynomials are those of fdlibm (Sun Microsystems 1993; `k_sin`, `k_cos`) with the
correction for that error. The error is below 1 ulp up to `REACH`; beyond it, for angles that are
not finite, and on a CPU without fused multiply-add, the C library is called for each angle.
"""

from __future__ import annotations

import math

from eomcheck.kernels.llvm import IRBuilder, has_fma, has_sincos

REACH = 1e5
"""Largest angle of the reduction, rad."""

VECTOR_WIDTH = 4
"""Number of angles of one state in a SIMD vector: wider vectors are seldom full, and slower."""

PARTS = 1.5707963267341256e00, 6.0771005063039655e-11, 2.0222662487959506e-21
"""Parts of π/2: its first 33 bits, the next 33, and the 53 after these."""

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
"""Summand that rounds a number of moderate size to an integer, in the last bits of the sum."""


def _called(flow: IRBuilder, code: IRBuilder, name: str, *x: str) -> tuple[str, str]:
    """Return the results, cosines and sines, of a call of a function of numbers `x`."""
    both = f"{{ {code.real}, {code.real} }}"
    arguments = ", ".join(f"{code.real} {y}" for y in x)
    result = flow.let(f"call {both} @{name}_{code.width}({arguments})")
    cos, sin = (flow.let(f"extractvalue {both} {result}, {i}") for i in range(2))
    return cos, sin


def _function(code: IRBuilder, name: str, cos: str, sin: str, *x: str) -> str:
    """Return the text of a function of numbers `x`, which returns cosines and sines."""
    both = f"{{ {code.real}, {code.real} }}"
    half = code.let(f"insertvalue {both} poison, {code.real} {cos}, 0")
    result = code.let(f"insertvalue {both} {half}, {code.real} {sin}, 1")
    arguments = ", ".join(f"{code.real} {y}" for y in x)
    head = f"define internal {both} @{name}_{code.width}({arguments}) nounwind"
    return code.function(head, f"{both} {result}")


def _by_function(flow: IRBuilder, code: IRBuilder, x: str) -> tuple[str, str]:
    """Return (cos x, sin x) by a call of a function of this width."""
    function = IRBuilder(code.width)
    text = _function(function, "sincos", *_inline(function, function, "%x"), "%x")
    flow.add_callees(*function.callees, text)
    return _called(flow, code, "sincos", x)


def _inline(flow: IRBuilder, code: IRBuilder, x: str) -> tuple[str, str]:
    """Return (cos x, sin x); `flow` builds the function, `code` has the width of x."""
    library = IRBuilder(code.width)
    flow.add_callees(_by_library(library))
    if not has_fma():
        return _called(flow, code, "library", x, x, x)
    fast = _reduced(code, x)
    yes, after = flow.labels("beyond", "after")
    before = flow.block
    flow.branch(code.anywhere(_beyond(code, x)), yes, after)
    flow.enter(yes)
    slow = _called(flow, code, "library", x, *fast)
    flow.jump(after)
    flow.enter(after)
    cos, sin = (
        flow.let(f"phi {code.real} [{one}, %{before}], [{other}, %{yes}]")
        for one, other in zip(fast, slow, strict=True)
    )
    return cos, sin


def _beyond(code: IRBuilder, x: str) -> str:
    """Return the condition that x is too large for `_reduced`, or NaN."""
    return code.compare("ugt", code.call("fabs", x), code.constant(REACH))


def _reduced(code: IRBuilder, x: str) -> tuple[str, str]:
    """Return (cos x, sin x) of angles up to `REACH`."""

    def fma(x: str, y: str, z: str) -> str:
        return code.call("fma", x, y, z)

    shifted = fma(x, code.constant(2 / math.pi), code.constant(TO_WHOLE))
    whole = code.let(f"bitcast {code.real} {shifted} to {code.type_of('i64')}")
    turns = code.sub(code.constant(TO_WHOLE), shifted)
    first = fma(turns, code.constant(PARTS[0]), x)
    r = code.add(first, code.mul(turns, code.constant(PARTS[1])))
    # The rounding error of r; it is 0 if the second part is the larger one, for then the sum is
    # exact.
    lost = fma(turns, code.constant(PARTS[1]), code.sub(first, r))
    y = fma(turns, code.constant(PARTS[2]), lost)
    z = code.mul(r, r)
    square = code.mul(z, z)

    def curve(coefficients: tuple[float, ...], factor: str, rest: str) -> str:
        """Return factor times a polynomial of z, plus rest; few operations depend on each other."""
        numbers = [code.constant(c) for c in coefficients]
        one, two, three = (fma(b, z, a) for a, b in zip(numbers[::2], numbers[1::2], strict=True))
        high = fma(three, square, two)
        return fma(code.mul(factor, square), high, fma(factor, one, rest))

    half = code.constant(-0.5)
    w = fma(z, half, code.constant(1.0))
    sin = code.add(r, curve(SIN, code.mul(z, r), code.mul(y, w)))
    lost = fma(z, half, code.sub(code.constant(1.0), w))
    cos = code.add(w, curve(COS, square, code.sub(lost, code.mul(r, y))))

    def flag(bits: str, mask: int) -> str:
        kind = code.type_of("i64")
        masked = code.let(f"and {kind} {bits}, {code.splat_of(f'i64 {mask}')}")
        return code.let(f"icmp ne {kind} {masked}, {code.splat_of('i64 0')}")

    odd = flag(whole, 1)
    after = code.let(f"add {code.type_of('i64')} {whole}, {code.splat_of('i64 1')}")
    c, s = code.choose(odd, sin, cos), code.choose(odd, cos, sin)
    return (
        code.choose(flag(after, 2), code.neg(c), c),
        code.choose(flag(whole, 2), code.neg(s), s),
    )


def _by_library(code: IRBuilder) -> str:
    """Return the function (x, cos x, sin x) that calls the C library for |x| > `REACH`.

    On a machine without fused multiply-add it does so for all angles.
    """
    results = cos, sin = [code.let(f"alloca {code.real}") for _ in range(2)]
    for result, x in zip(results, ("%cos", "%sin"), strict=True):
        code.store(x, result)
    where = _beyond(code, "%x") if has_fma() else code.splat_of("i1 true")
    for lane in range(code.width):
        with code.when(code.lane_of_condition(where, lane)):
            addresses = (code.address(result, lane, "double") for result in (cos, sin))
            library_call(code, code.lane("%x", lane), *addresses)
    return _function(code, "library", *map(code.load, results), "%x", "%cos", "%sin")


def library_call(code: IRBuilder, angle: str, cos: str, sin: str) -> None:
    """Write the cosine and sine of an angle, by the C library, to two addresses."""
    if has_sincos():
        code.do(f"call void @sincos(double {angle}, ptr {sin}, ptr {cos})")
        return
    for name, address in (("sin", sin), ("cos", cos)):
        code.do(f"store double {code.let(f'call double @{name}(double {angle})')}, ptr {address}")


def cos_and_sin(code: IRBuilder, x: list[str]) -> list[str]:
    """Return the cosines, then the sines, of a few values."""
    wide = code if code.width > 1 or len(x) == 1 else code.wider(VECTOR_WIDTH)
    step = wide.width // code.width
    compute = _inline if len(x) <= step else _by_function
    results: list[list[str]] = [[], []]
    for first in range(0, len(x), step):
        some = x[first : first + step]
        angles = some[0] if step == 1 else _padded(wide, some)
        for out, y in zip(results, compute(code, wide, angles), strict=True):
            out += [y] if step == 1 else [wide.lane(y, i) for i in range(len(some))]
    return [*results[0], *results[1]]


def _padded(wide: IRBuilder, doubles: list[str]) -> str:
    """Return the number with `doubles` in its first lanes and 0 in the others."""
    out = "zeroinitializer"
    for i, x in enumerate(doubles):
        out = wide.let(f"insertelement {wide.real} {out}, double {x}, i64 {i}")
    return out


def padded_count(count: int) -> int:
    """Return the number of cosines that `write` writes for `count` angles: whole vectors."""
    return -(-count // VECTOR_WIDTH) * VECTOR_WIDTH


def write(code: IRBuilder, x: str, cos: str, sin: str, count: int) -> None:
    """Write the cosines and sines of `count` numbers at x to the addresses `cos` and `sin`."""
    wide = code if code.width > 1 else code.wider(VECTOR_WIDTH)
    step = wide.width // code.width
    full, left = divmod(count, step)

    def store(angles: str, first: int | str) -> None:
        for y, target in zip(_by_function(code, wide, angles), (cos, sin), strict=True):
            wide.store(y, code.address(target, first))

    if full:
        with code.loop(full) as turn:
            at = turn.i if step == 1 else code.integer("mul", turn.i, step)
            store(wide.load(code.address(x, at)), at)
    if left:  # nothing past the end is read
        first = full * step
        store(_padded(wide, [code.load(x, first + i) for i in range(left)]), first)
