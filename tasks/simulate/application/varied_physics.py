"""What of a compiled robot a factor of its mass, friction or motor strength changes; engines scale their own arrays."""

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Bool

WITH_MASS = ("body_mass", "body_inertia", "body_subtreemass", "dof_armature", "dof_M0")
"""Arrays of a model that are as many times as large; armature counts as mass, so that all that follows scales alike."""
AGAINST_MASS = ("body_invweight0", "dof_invweight0", "tendon_invweight0")
WITH_STRENGTH = ("actuator_forcerange", "jnt_actfrcrange")
# Of a muscle: its peak force, and what that is computed from where it is not given (MuJoCo, XML reference, "muscle").
_OF_MUSCLE = (2, 3)


def force_columns(model: mujoco.MjModel) -> Mapping[str, Bool[np.ndarray, "actuators parameters"]]:
    """Returns which parameters of gains and biases the force of an actuator is proportional to, by array."""
    muscle = np.zeros(model.actuator_gainprm.shape[1], bool)
    muscle[[*_OF_MUSCLE]] = True
    gains = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_MUSCLE)[:, None]
    biases = (model.actuator_biastype == mujoco.mjtBias.mjBIAS_MUSCLE)[:, None]
    return {
        "actuator_gainprm": muscle | ~gains,
        "actuator_biasprm": muscle | ~biases,
    }
