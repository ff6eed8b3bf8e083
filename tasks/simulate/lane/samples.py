"""Samples of what lanes do: what a recorder keeps of each slice of control steps, and how lanes end."""

from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

# Of the control rate; at less, an episode of two weeks would have two samples.
_LEAST_RATE = 1e-8


class Steps(Protocol):
    """What is recorded of a slice of control steps, (lanes, steps) first; as ``lane_state.StepRecord``."""

    @property
    def pose(self) -> object:
        """Returns poses at the steps' ends."""
        ...

    @property
    def velocity(self) -> object:
        """Returns velocities at the steps' ends."""
        ...

    @property
    def goal_index(self) -> object:
        """Returns goals to go to at the steps' ends."""
        ...

    @property
    def control(self) -> object:
        """Returns controls during the steps."""
        ...

    @property
    def ranges_m(self) -> object:
        """Returns scans at the steps' beginnings."""
        ...

    @property
    def impulse_ns(self) -> object:
        """Returns contact impulses during the steps."""
        ...


class Ends(NamedTuple):
    """How the lanes ended, for lanes in their order.

    Attributes:
        steps: Control steps that were done.
        crashed: Whether a step after those was begun, and went wrong.
        goals_m: Where each lane's robot should go, in order; its last goal again where other lanes have more.
        lidars: Each robot's lidar: where it is mounted (x m, y m, yaw rad), the height of its plane and its range (m),
            the direction of its first ray and the turn from one to the next (rad).
    """

    steps: Int[np.ndarray, "lanes"]
    crashed: Bool[np.ndarray, "lanes"]
    start: Float[np.ndarray, "lanes 3"]
    pose: Float[np.ndarray, "lanes 3"]
    velocity: Float[np.ndarray, "lanes 3"]
    goal_index: Int[np.ndarray, "lanes"]
    goals_m: Float[np.ndarray, "lanes goals 2"]
    lidars: Float[np.ndarray, "lanes 7"]


class SliceSamples(NamedTuple):
    """What is kept of a slice of control steps, lanes first.

    Attributes:
        steps: How many control steps the slice has.
        pose, velocity, goal_index: At the ends of the steps before which a sample is due.
        control, ranges_m: Of the steps for which a sample is due.
        last_control, last_ranges_m: Of each lane's last step in the slice.
        impulse_ns: Of every step.
    """

    steps: int
    pose: np.ndarray
    velocity: np.ndarray
    goal_index: np.ndarray
    control: np.ndarray
    ranges_m: np.ndarray
    last_control: np.ndarray
    last_ranges_m: np.ndarray
    impulse_ns: np.ndarray


def sample_stride(rate_hz: float, control_s: float) -> int:
    """Returns how many control steps lie between samples at a rate, made a whole fraction of the control rate."""
    return max(1, round(1.0 / max(rate_hz * control_s, _LEAST_RATE)))


def slice_samples(
    slice_: Steps, steps: Int[np.ndarray, "lanes"], *, lanes: int, before: int, stride: int
) -> SliceSamples:
    """Returns what is kept of a slice.

    Args:
        slice_: Its control steps.
        steps: How many control steps each lane has done by its end.
        lanes: How many lanes hold episodes.
        before: Control steps of the slices before.
        stride: Control steps from a sample to the next.
    """
    impulse = np.asarray(slice_.impulse_ns)[:lanes]
    length = impulse.shape[1]
    numbers = np.arange(before, before + length)
    begun, ended = np.flatnonzero(numbers % stride == 0), np.flatnonzero((numbers + 1) % stride == 0)
    # Where a lane came to its end, wherever in the slice: what it had decided when it crashed.
    last = np.clip(steps[:lanes] - before, 0, length - 1)
    control, ranges_m = np.asarray(slice_.control)[:lanes], np.asarray(slice_.ranges_m)[:lanes]
    every = np.arange(lanes)
    return SliceSamples(
        steps=length,
        pose=np.asarray(slice_.pose)[:lanes, ended],
        velocity=np.asarray(slice_.velocity)[:lanes, ended],
        goal_index=np.asarray(slice_.goal_index)[:lanes, ended],
        control=control[:, begun],
        ranges_m=ranges_m[:, begun],
        last_control=control[every, last],
        last_ranges_m=ranges_m[every, last],
        impulse_ns=impulse.astype(np.float32),
    )
