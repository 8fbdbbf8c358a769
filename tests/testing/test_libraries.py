"""Functions of JAX and of PyTorch: right in doubles, named where they are in single precision."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import pytest

CART = """
m0, m, length, g = 2.0, 0.7, 0.6, 9.81

def T(q, v):
    swing = length * v[1]
    return m0 * v[0] ** 2 / 2 + m * (v[0] ** 2 + swing**2 + 2 * v[0] * swing * cos(q[1])) / 2

def U(q):
    return -m * g * length * cos(q[1])
"""
"""A cart with a pendulum: energies, of which the library derives the rest."""

JAX = f"""
import jax
jax.config.update("jax_enable_x64", DOUBLES)
import jax.numpy as jnp
from jax.numpy import cos
{CART}
M = jax.jit(lambda q: jax.hessian(T, 1)(q, jnp.zeros(2)))
gravity = jax.jit(jax.grad(U))

@jax.jit
def bias(q, v):
    return jax.jvp(lambda q: jax.grad(T, 1)(q, v), (q,), (v,))[1] - jax.grad(T)(q, v)

def qdd(q, v):
    return jnp.linalg.solve(M(q), -bias(q, v) - gravity(q))

options = {{}}
"""

TORCH = f"""
import torch
from torch import cos
{CART}
def derived(f, x):
    return torch.autograd.grad(f, x, create_graph=True, materialize_grads=True)[0]

def M(q):
    v = torch.zeros(2, dtype=q.dtype, requires_grad=True)
    momentum = derived(T(q, v), v)
    return torch.stack([derived(p, v) for p in momentum])

def gravity(q):
    q = q.detach().requires_grad_()
    return derived(U(q), q)

def bias(q, v):
    q, v = (x.detach().requires_grad_() for x in (q, v))
    energy = T(q, v)
    momentum = derived(energy, v)
    return [derived(p, q) @ v - force for p, force in zip(momentum, derived(energy, q))]

def qdd(q, v):
    return torch.linalg.solve(M(q), -torch.stack(bias(q, v)) - gravity(q))

def made(x):
    return torch.tensor(x, dtype=torch.float64 if DOUBLES else torch.float32, requires_grad=GRAD)

options = {{"array": made}}
"""

CHECK = """
from eomcheck.testing import check_functions
given = {"M": M, "bias": bias, "gravity": gravity, "qdd": qdd, "T": T, "U": U}
for one in check_functions(2, **(given | WRONG), states=3, **options):
    if one.verdict != "passed":
        print(f"{one.claim} [{one.subject}] {one.verdict}: {one.detail}")
"""


def told(source: str, wrong: str = "{}", **switches: bool) -> list[str]:
    """Return what does not pass, in a process of its own: both libraries have switches for all."""
    library = "jax" if "import jax" in source else "torch"
    if find_spec(library) is None:
        pytest.skip(f"{library} is not installed")
    for name, value in switches.items():
        source = source.replace(name, str(value))
    code = source + CHECK.replace("WRONG", wrong)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [line for line in done.stdout.splitlines() if not line.startswith("reference")]


DOUBLES = {
    "jax": (JAX, {"DOUBLES": True}),
    "torch": (TORCH, {"DOUBLES": True, "GRAD": False}),
    "torch with gradients": (TORCH, {"DOUBLES": True, "GRAD": True}),
}
SINGLES = {
    "jax": (JAX, {"DOUBLES": False}),
    "torch": (TORCH, {"DOUBLES": False, "GRAD": False}),
    "torch with gradients": (TORCH, {"DOUBLES": False, "GRAD": True}),
}


@pytest.mark.parametrize("how", DOUBLES)
def test_functions_in_doubles_pass(how: str):
    source, switches = DOUBLES[how]
    assert told(source, **switches) == []


@pytest.mark.parametrize("how", DOUBLES)
def test_a_wrong_sign_in_them_is_named(how: str):
    source, switches = DOUBLES[how]
    first, *_ = told(source, '{"gravity": lambda q: -gravity(q)}', **switches)
    assert first.startswith("gravity-of-potential [gravity] failed: gravity is wrong: ")
    assert "; gravity, row q[1]: wrong sign" in first


@pytest.mark.parametrize("how", SINGLES)
def test_functions_in_singles_are_named_by_their_precision_and_by_nothing_else(how: str):
    source, switches = SINGLES[how]
    lines = told(source, **switches)
    assert {line.split("]")[0] for line in lines} == {
        f"double-precision [{name}" for name in ("M", "bias", "gravity", "qdd", "T", "U")
    }
    assert all("failed" in line and line.endswith("in float32") for line in lines)


def test_functions_of_tensors_that_get_arrays_say_what_to_give():
    lines = told(TORCH.replace('{"array": made}', "{}"), DOUBLES=True, GRAD=False)
    (first, *_) = [line for line in lines if line.startswith("answers [T]")]
    assert first.endswith("; say array=torch.as_tensor")
