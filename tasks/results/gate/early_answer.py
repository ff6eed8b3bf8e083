"""Answers a gate before its batch has ended, as soon as the answer is certain.

``tasks.results.statistics.looks.anytime`` says why one may ask after each chunk.
"""

from collections import Counter
from collections.abc import Sequence

from specs.data.episode import CANCELED, EpisodeResult
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import SEQUENTIAL_RULES, Gate
from tasks.results.gate.gate import GATE_RULES, combine
from tasks.results.gate.rules.rule import Completeness, GateMaterial, Share
from tasks.results.statistics.success import Ending, EpisodeCounts, count_endings, ending_of


class EarlyAnswer:
    """Counts a batch's episodes as they end, for the rules that can be sure early."""

    def __init__(self, gate: Gate) -> None:
        """Begins to count."""
        asked = [(rule, label, section) for rule in GATE_RULES for label, section in rule.asked(gate)]
        self._rules = [each for each in asked if each[0].name in SEQUENTIAL_RULES]
        self._all_can_be_sure = len(self._rules) == len(asked)
        self._endings: Counter[Ending] = Counter()
        self._shares = {label: Share() for rule, label, _ in self._rules if rule.count}

    def add(self, results: Sequence[EpisodeResult]) -> None:
        """Counts episodes."""
        self._endings.update(map(ending_of, results))
        ended = [result for result in results if result.status != CANCELED]
        for rule, label, asked in self._rules:
            if rule.count:
                values = {name: [getattr(result, name) for result in ended] for name in rule.columns(asked)}
                self._shares[label] = self._shares[label].plus(rule.count(values))

    def episodes(self) -> int:
        """Returns how many came to an end so far."""
        return self._counts().episodes

    def answer(self) -> Verdict | None:
        """Returns what the gate will answer whatever comes; None as long as that is open.

        A rule that fails fails the gate. That it passes needs all of its rules, and only those that count episodes one
        by one can be asked before the end.
        """
        counts = self._counts()
        lacks = Completeness(canceled=counts.canceled, sequential=True)
        material = GateMaterial(counts, lacks, shares=self._shares)
        answer = combine([rule.judge(asked, material, label).verdict for rule, label, asked in self._rules])
        return answer if answer == "FAIL" or (answer == "PASS" and self._all_can_be_sure) else None

    def _counts(self) -> EpisodeCounts:
        return count_endings(self._endings)
