"""The order in which a batch that may be ended early takes its episodes: any beginning of it stands for the whole.

It follows from the batch's plan alone and from no library's release: a batch that is continued elsewhere has the chunks
that it had.
"""

import hashlib
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True, eq=False)
class Shuffle:
    """A drawn order of some positions.

    Attributes:
        size: How many positions there are, from 0.
        seed: What the order follows from.
    """

    size: int
    seed: str

    @cached_property
    def order(self) -> tuple[int, ...]:
        """The positions, in their drawn order."""
        return tuple(sorted(range(self.size), key=self._drawn))

    @cached_property
    def turn(self) -> tuple[int, ...]:
        """For each position, when its turn is."""
        turns = [0] * self.size
        for turn, position in enumerate(self.order):
            turns[position] = turn
        return tuple(turns)

    def _drawn(self, position: int) -> bytes:
        return hashlib.sha256(f"{self.seed}/{position}".encode()).digest()
