"""A controller in plain Python that drives by what its colour camera shows; FAULT is the share of its noise."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tasks.simulate.application.contract import Observation

jax = False


class ColorCamera(NamedTuple):
    noise: float
    columns: int = 16
    rows: int = 12
    rate_hz: float = 10.0
    latency_steps: int = 1
    light_spread: float = 0.3


class Watching:
    def __init__(self, noise: float) -> None:
        self.color_camera = ColorCamera(noise)

    def reset(self, floor: object, goals_m: object) -> None:
        pass

    def step(self, observation: Observation) -> list[float]:
        seen = np.asarray(observation.color)
        assert seen.shape == (12, 16, 3)
        assert seen.dtype == np.uint8
        left, right = seen[:, :8].mean() / 255.0, seen[:, 8:].mean() / 255.0
        return [0.5 * (left + right), 0.0, 2.0 * (left - right) + 0.3]


def controller(environment: Mapping[str, float]) -> Watching:
    return Watching(environment["FAULT"])
