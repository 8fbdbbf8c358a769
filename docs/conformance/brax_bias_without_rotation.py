"""Brax's bias of a body that slides and does not turn is its rounding, where it is 0.

`dynamics.inverse` has the cross product of the velocity and the momentum, which are parallel. With
fused multiplication and addition, by which JAX compiles it, a product less the same product is not
0 but the rounding of one. Without gravity all other terms have the angular velocity as a factor.
"""

import warnings

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from brax.generalized import dynamics, pipeline
    from brax.io import mjcf

    system = mjcf.loads("""<mujoco><option gravity="0 0 0"/><worldbody><body>
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>
      <geom size="0.1" pos="0.5 0 0" mass="1"/></body></worldbody></mujoco>""")


def bias(q, v):
    return dynamics.inverse(system, pipeline.init(system, q, v))


q, v = np.array([-7.1, -1.3, -2.0]), np.array([-1.0384712907818903, -2.084124381957015, 0.0])
print("compiled", np.asarray(jax.jit(bias)(q, v)), "expected [0, 0, 0]")
with jax.disable_jit():
    print("operation by operation", np.asarray(bias(q, v)))
