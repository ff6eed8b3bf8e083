"""A controller whose import has every controller in plain Python of its process stand still."""

from collections.abc import Mapping

import numpy as np

from tasks.simulate.host import controllers

from . import driving

jax = False
controllers.real_control = lambda _doing, _control, shape: np.zeros(shape, np.float32)


def controller(environment: Mapping[str, float]) -> object:
    return driving.controller(environment)
