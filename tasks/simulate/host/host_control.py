"""Checks what a controller on the host returns: real numbers in the right shape."""

import numpy as np
from jaxtyping import Float32

from tasks.simulate.application.code import BundleCrash, CrashCode, call_bundle

_ROBOT: CrashCode = "RobotApplicationCrash"
# Floats and integers: what a person writes in Python for a number.
_REAL_KINDS = "fiu"


def real_control(doing: str, control: object, shape: tuple[int, ...]) -> Float32[np.ndarray, "*shape"]:
    """Returns a control as an array.

    Args:
        doing: Which function returned it, for a person.
        control: Whatever it returned.
        shape: That it must have.

    Raises:
        BundleCrash: It is no array of real numbers, or has another shape.
    """
    array = call_bundle(_ROBOT, doing, np.asarray, control)
    if array.dtype.kind not in _REAL_KINDS:
        raise BundleCrash(_ROBOT, f"{doing}: control of {array.dtype}, not of real numbers")
    if array.shape != shape:
        shown = f"({shape[0]},)" if len(shape) == 1 else str(shape)
        raise BundleCrash(_ROBOT, f"{doing}: control of shape {array.shape}, not {shown}")
    return array.astype(np.float32)
