"""A controller in plain Python that counts, keeps lists, and goes wrong in the way that FAULT says."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from tasks.simulate.application.contract import HostMap, Observation

jax = False
SOUND, RAISING, MISSHAPEN, LATE_RAISING, UNMADE = 0.0, 1.0, 2.0, 3.0, 4.0


class Lidar(NamedTuple):
    rays: int = 8
    range_m: float = 6.0
    height_m: float = 0.25


class Counting:
    lidar = Lidar()

    def __init__(self, fault: float) -> None:
        if fault == UNMADE:
            raise ValueError("nobody makes me")
        self._fault = fault
        self._seen: list[float] = []

    def reset(self, floor: HostMap, goals_m: object) -> None:
        assert floor.clearance_m.ndim == 2
        assert (Path(__file__).parent / "counting.py").exists()
        if self._fault == RAISING:
            raise RuntimeError("no idea where to go")

    def step(self, observation: Observation) -> list[float]:
        self._seen.append(float(observation.ranges_m.min()))
        if self._fault == LATE_RAISING and len(self._seen) > 20:
            raise RuntimeError("tired of this")
        if self._fault == MISSHAPEN:
            return [0.0]
        return [0.4, 0.0, 1.2 if len(self._seen) % 40 < 20 else -1.2]


def controller(environment: Mapping[str, float]) -> Counting:
    return Counting(environment["FAULT"])
