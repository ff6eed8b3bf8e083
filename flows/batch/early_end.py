"""The early end of a batch: ends it after the chunk that makes its gate certain, and records why."""

from pydantic import JsonValue

from specs.pipeline.gate_section import Gate
from tasks.results.gate.early_answer import EarlyAnswer
from tasks.simulate.batch.chunk_store import counted_chunk
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.stop import leave_out


class EarlyEnd:
    """Looks at a batch after each chunk, in their order: a batch that is continued ends where it would have.

    Attributes:
        detail: What the batch's record says of its early end; empty if there was none.
    """

    def __init__(self, batch: OpenBatch, gate: Gate | None) -> None:
        """Begins to look, at a batch whose gate asks for it and whose plan allows it."""
        self.detail: dict[str, JsonValue] = {}
        self._batch = batch
        self._gate = gate if batch.plan.shuffled else None
        self._answer = EarlyAnswer(self._gate) if self._gate else None

    def ends_before(self, number: int) -> bool:
        """Returns whether the gate is certain after the chunks before that one; if so, the rest is left out."""
        if self._answer is None or self._gate is None or number == 0:
            return False
        rows = counted_chunk(self._batch.store, self._batch.id, number - 1, self._batch.voucher)
        self._answer.add(rows or ())
        answer = self._answer.answer()
        if answer is None:
            return False
        left_out, ended = leave_out(self._batch, number), self._answer.episodes()
        were = "was" if left_out == 1 else "were"
        sentence = f"the gate was certain of {answer} after {ended} episodes, so that {left_out} {were} left out"
        self.detail["stopped_early"] = {
            "gate": self._gate.model_dump(mode="json"),
            "verdict": answer,
            "sentence": sentence,
            "episodes": ended,
            "left_out": left_out,
        }
        return True
