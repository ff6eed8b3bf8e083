"""Which episodes of a chunk are recorded: the run asks for them, and the process that simulates tells no others."""

import numpy as np
from jaxtyping import Bool

from specs.base import Spec
from specs.data.episode_columns import EpisodeColumns


class RecordingChoice(Spec):
    """Which of some episodes are recorded, if they come to an end.

    Attributes:
        always: Indices of those that are, however they end.
        failed: Whether others are that fail.
    """

    always: tuple[int, ...] = ()
    failed: bool = False

    def chosen(self, rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        """Returns which of these episodes are recorded."""
        chosen = np.isin(rows.index, self.always)
        if self.failed:
            chosen |= rows.says("status", "Failed") | rows.says("outcome", "Failed")
        return chosen & ~rows.says("status", "Canceled")
