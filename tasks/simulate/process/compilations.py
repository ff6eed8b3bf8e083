"""The programs that a process compiles, for whoever listens to progress: seconds in which no episode goes on."""

from tasks.progress.listener import report_progress
from tasks.simulate.process.work import Answer, Compiles

STAGE = "Compilation"
# A process has a few programs; what an application has it say beyond that is not shown.
_MOST = 64


class Compilations:
    """Counts the programs of a process."""

    def __init__(self) -> None:
        """Begins without programs."""
        self._begun = self._ended = 0

    def hear(self, answer: Answer) -> None:
        """Tells the listener of this context when a program begins to be compiled, and when it is there."""
        if self._ended < self._begun:
            self._ended = self._begun
            report_progress(STAGE, self._ended, self._begun)
        if isinstance(answer, Compiles) and self._begun < _MOST:
            self._begun += 1
            report_progress(STAGE, self._ended, self._begun)
