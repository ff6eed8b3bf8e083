"""The early end of a batch: ends it after the chunk that makes its gate certain, and records why."""

from pydantic import JsonValue

from specs.data.episode import EpisodeResult
from specs.errors import ResourceNotFound
from specs.pipeline.gate_section import Gate
from tasks.applications.registry import resolve
from tasks.results.gate.early_answer import EarlyAnswer
from tasks.simulate.batch.chunk_store import counted_chunk
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.stop import leave_out


class EarlyEnd:
    """Looks at a batch after each chunk, in their order: a batch that is continued ends where it would have.

    Where two versions take turns on the same episodes, it looks after each second chunk.

    Attributes:
        detail: What the batch's record says of its early end; empty if there was none.
    """

    def __init__(self, batch: OpenBatch, gate: Gate | None) -> None:
        """Begins to look, at a batch whose gate asks for it and whose plan allows it."""
        self.detail: dict[str, JsonValue] = {}
        self._batch, self._paired = batch, batch.plan.shuffled == "pairs"
        self._other, self._first = "", list[EpisodeResult]()
        if gate and self._paired:
            self._other = _compared_with(batch, gate)
        self._gate = gate if batch.plan.shuffled and (self._other or not self._paired) else None
        self._answer = EarlyAnswer(self._gate, batch.layout.looks(), paired=self._paired) if self._gate else None

    def ends_before(self, number: int) -> bool:
        """Returns whether the gate is certain after the chunks before that one; if so, the rest is left out."""
        if self._answer is None or self._gate is None or number == 0 or not self._counted(number - 1, self._answer):
            return False
        answer = self._answer.answer()
        if answer is None:
            return False
        left_out, ended = leave_out(self._batch, number), self._answer.episodes()
        were = "was" if left_out == 1 else "were"
        after = f"{ended} episodes of each version" if self._paired else f"{ended} episodes"
        sentence = f"the gate was certain of {answer} after {after}, so that {left_out} {were} left out"
        self.detail["stopped_early"] = {
            "gate": self._gate.model_dump(mode="json"),
            "verdict": answer,
            "sentence": sentence,
            "episodes": ended,
            "left_out": left_out,
            **self._looks(),
        }
        return True

    def _looks(self) -> dict[str, JsonValue]:
        """Returns after how many episodes the gate was asked; of a batch of before there is nothing to say."""
        looks = self._batch.layout.looks()
        return {"looks": list(looks)} if looks else {}

    def _counted(self, number: int, answer: EarlyAnswer) -> bool:
        """Counts a chunk; returns whether the gate may be asked now."""
        rows = list(counted_chunk(self._batch.store, self._batch.id, number, self._batch.voucher) or ())
        if not self._paired:
            answer.add(rows)
            return True
        if number % 2 == 0:
            self._first = rows
            return False
        other_now = self._batch.layout.chunk(number).requests[0].robot.digest == self._other
        answer.add(*(self._first, rows) if other_now else (rows, self._first))
        return True


def _compared_with(batch: OpenBatch, gate: Gate) -> str:
    """Returns the digest of the version that the gate compares with, if the batch drives it; else nothing."""
    robots = [template.robot for template in batch.plan.templates]
    if gate.noWorseThan is None or len({robot.name for robot in robots}) != 1:
        return ""
    try:
        digest = resolve(batch.store, "robot-application", robots[0].name, gate.noWorseThan.applicationVersion).digest
    except ResourceNotFound:
        return ""
    return digest if digest in {robot.digest for robot in robots} else ""
