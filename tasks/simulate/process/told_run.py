"""What a process tells a recorder of its lanes: only what the recorder can take is let pass."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.lane.samples import Ends, SliceSamples
from tasks.simulate.process.work import RecordingBegins, Samples

# The sides of arrays: a number, up to one for each step (?), or a name for one that is the same wherever it stands. All
# have a lane first; lanes beyond those that hold episodes may follow.
_SAMPLES = ("? 3", "? velocity", "?", "? controls", "? rays", "controls", "rays", "steps")
_ENDS = ("", "", "3", "3", "velocity", "", "goals 2", "7")
# Of sides with names: a bundle's lidar has no more rays (specs.bundle.sensors), and no robot so many of the others.
_MOST = {"rays": 4096, "velocity": 4096, "controls": 4096, "goals": 1 << 16}
_WIDEST = 8


class ToldRun:
    """A run of lanes, as a process tells it."""

    def __init__(self, begins: RecordingBegins, most: int, most_steps: int) -> None:
        """Begins without samples.

        Args:
            begins: Says how many lanes hold episodes.
            most: How many can at most.
            most_steps: How many control steps they can do at most.

        Raises:
            ValueError: No run begins so.
        """
        if not (0 < begins.lanes <= most and 0.0 < begins.control_s < math.inf):
            raise ValueError(f"a recording of {begins.lanes} lanes with steps of {begins.control_s} s")
        self._lanes, self._steps, self._sides = begins.lanes, 0, dict[str, int]()
        self._most_steps = most_steps

    def samples(
        self, told: Samples, arrays: Sequence[np.ndarray]
    ) -> tuple[SliceSamples, Int[np.ndarray, "lanes"]]:  # fmt: skip
        """Returns the samples of a slice, and how many steps each lane has done.

        Raises:
            ValueError: They are none.
        """
        self._steps += told.steps
        if not (0 < told.steps <= self._steps <= self._most_steps):
            raise ValueError(f"a recording that goes on for {self._steps} steps")
        self._sides["steps"] = told.steps
        self._check(arrays, (*_SAMPLES, ""), most=told.steps)
        _check_counts(arrays[2])
        return SliceSamples(told.steps, *(array[: self._lanes] for array in arrays[:-1])), arrays[-1]

    def ends(self, rows: EpisodeColumns, arrays: Sequence[np.ndarray]) -> Ends:
        """Returns how the lanes ended.

        Args:
            rows: The lanes' results.
            arrays: The rest of what was told.

        Raises:
            ValueError: So they cannot have ended.
        """
        self._check(arrays, _ENDS)
        ends = Ends(*arrays)
        _check_counts(ends.steps, ends.goal_index)
        if len(rows) != self._lanes or ends.steps.max() > self._steps or not self._sides["goals"]:
            raise ValueError("a recording that ends otherwise than it went")
        return ends

    def _check(self, arrays: Sequence[np.ndarray], forms: Sequence[str], most: int = 0) -> None:
        for array, form in zip(arrays, forms, strict=True):
            lanes, sides = array.shape[:1], array.shape[1:]
            if not lanes or lanes[0] < self._lanes:
                raise ValueError("a recording that lacks lanes")
            if array.dtype.itemsize > _WIDEST:
                raise ValueError("a recording of numbers that no engine has")
            for side, name in zip(sides, form.split(), strict=True):
                if not self._fits(side, name, most):
                    raise ValueError("a recording with arrays of other sides")

    def _fits(self, side: int, name: str, most: int) -> bool:
        if name == "?":
            return side <= most
        if name.isdecimal():
            return side == int(name)
        return side <= _MOST.get(name, side) and side == self._sides.setdefault(name, side)


def _check_counts(*arrays: np.ndarray) -> None:
    if any(array.dtype.kind not in "iu" or array.min(initial=0) < 0 for array in arrays):
        raise ValueError("a recording with counts that are none")
