"""Whether a gate is certain before its batch has ended; ``sequential`` says why one may ask repeatedly."""

from collections.abc import Sequence

from specs.data.episode import CANCELED, EpisodeResult, success
from specs.data.run_report import Verdict as Answer
from specs.pipeline.gate_section import RULES, SEQUENTIAL_RULES, Gate
from tasks.results.gate.gate import together
from tasks.results.gate.gate_rules import Completeness, RuleVerdict, collision_rule, success_rule
from tasks.results.statistics.success import EpisodeCounts


class EarlyAnswer:
    """Counts a batch's episodes as they end, for the rules that can be sure early."""

    def __init__(self, gate: Gate) -> None:
        """Begins to count."""
        self._gate = gate
        self._counts = EpisodeCounts(episodes=0, successes=0, failed_jobs=0, canceled=0)
        self._collided, self._unknown = 0, 0

    def add(self, results: Sequence[EpisodeResult]) -> None:
        """Counts episodes."""
        ended = [result for result in results if result.status != CANCELED]
        touched = [result.collisions > 0 for result in ended]
        failed = [result.status == "Failed" for result in ended]
        before = self._counts
        self._counts = EpisodeCounts(
            episodes=before.episodes + len(ended),
            successes=before.successes + sum(success(result) is True for result in ended),
            failed_jobs=before.failed_jobs + sum(failed),
            canceled=before.canceled + len(results) - len(ended),
        )
        self._collided += sum(touched)
        self._unknown += sum(job and not contact for job, contact in zip(failed, touched, strict=True))

    def episodes(self) -> int:
        """Returns how many came to an end so far."""
        return self._counts.episodes

    def answer(self) -> Answer | None:
        """Returns what the gate will answer whatever comes; None as long as that is open.

        A rule that fails fails the gate. That it passes needs all of its rules, and only those that count episodes one
        by one can be asked before the end.
        """
        answers: list[Answer] = [rule.verdict for rule in self._rules()]
        if "FAIL" in answers:
            return "FAIL"
        asked = [name for name in RULES if getattr(self._gate, name) is not None]
        return "PASS" if set(asked) <= set(SEQUENTIAL_RULES) and together(answers) == "PASS" else None

    def _rules(self) -> list[RuleVerdict]:
        counts, gate = self._counts, self._gate
        lacks = Completeness(canceled=counts.canceled, sequential=True)
        found: list[RuleVerdict] = []
        if gate.successRate:
            found.append(success_rule(counts, gate.successRate, lacks))
        if gate.collisionRate:
            found.append(collision_rule(self._collided, self._unknown, counts.episodes, gate.collisionRate, lacks))
        return found
