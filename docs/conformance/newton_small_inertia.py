"""Newton adds 1e-6 kg m² to all moments of inertia of a body that is thin.

`finalize` shifts them where the least is below 1e-6 of the largest. That of a rod about its own
axis is 0; those across it, of a rod of 1 g and 10 cm 8.3e-7 kg m², more than double. A warning
counts the bodies that were changed.
"""

import newton
import numpy as np
import warp as wp

moment = 1e-3 * 0.1**2 / 12
builder = newton.ModelBuilder()
inertia = wp.mat33(np.diag([moment, moment, 0.0]))
rod = builder.add_link(mass=1e-3, inertia=inertia)
builder.add_articulation([builder.add_joint_revolute(-1, rod, axis=newton.Axis.X)])
for skip in (False, True):
    model = builder.finalize(device="cpu", skip_validation_inertia=skip)
    state = model.state()
    newton.eval_fk(model, state.joint_q, state.joint_qd, state)
    print("validated" if not skip else "as it is ", newton.eval_mass_matrix(model, state).numpy())
print("expected ", moment)
