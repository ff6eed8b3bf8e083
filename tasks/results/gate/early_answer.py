"""Answers a gate before its batch has ended, as soon as the answer is certain.

``tasks.results.statistics.looks.repeated_interval`` says why one may ask after each chunk.
"""

from collections import Counter
from collections.abc import Hashable, Sequence

from specs.data.episode import CANCELED, EpisodeResult, success
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import SEQUENTIAL_RULES, Gate
from tasks.results.gate.gate import GATE_RULES, combine
from tasks.results.gate.rules.pair_counts import PairCounts, count_pairs
from tasks.results.gate.rules.rule import Completeness, GateMaterial, Share
from tasks.results.statistics.pairs import Drive
from tasks.results.statistics.success import Ending, EpisodeCounts, count_endings, ending_of

_PAIRED = "noWorseThan"


class EarlyAnswer:
    """Counts a batch's episodes as they end, for the rules that can be sure early."""

    def __init__(self, gate: Gate, looks: tuple[int, ...] = (), *, paired: bool = False) -> None:
        """Begins to count.

        Args:
            gate: What is asked for.
            looks: After how many episodes it is asked, the last being all of them; none of a batch of before.
            paired: Whether the other version drives each episode, too, before the next is looked at.
        """
        asked = [(rule, label, section) for rule in GATE_RULES for label, section in rule.asked(gate)]
        sure = [name for name in SEQUENTIAL_RULES if paired or name != _PAIRED]
        self._rules = [each for each in asked if each[0].name in sure]
        self._all_can_be_sure = len(self._rules) == len(asked)
        self._looks, self._paired = looks, paired
        self._endings: Counter[Ending] = Counter()
        self._pairs = PairCounts(n=0, gains=0, losses=0, unpaired=0)
        self._shares = {label: Share() for rule, label, _ in self._rules if rule.count}

    def add(self, results: Sequence[EpisodeResult], other: Sequence[EpisodeResult] = ()) -> None:
        """Counts episodes.

        Args:
            results: Of the tested version.
            other: Of the other version on the same episodes, in the same order.
        """
        self._endings.update(map(ending_of, results))
        self._pairs = self._pairs.plus(count_pairs(_drives(results), _drives(other)))
        ended = [result for result in results if result.status != CANCELED]
        for rule, label, asked in self._rules:
            if rule.count:
                values = {name: [getattr(result, name) for result in ended] for name in rule.columns(asked)}
                self._shares[label] = self._shares[label].plus(rule.count(values))

    def episodes(self) -> int:
        """Returns how many came to an end so far; of the tested version."""
        return self._counts().episodes

    def answer(self) -> Verdict | None:
        """Returns what the gate will answer whatever comes; None as long as that is open.

        A rule that fails fails the gate. That it passes needs all of its rules, and only those that count episodes one
        by one can be asked before the end. Where narrower intervals leave it open, the right ones are not computed.
        """
        return self._answer(inner=False) if not self._looks or self._answer(inner=True) else None

    def _answer(self, *, inner: bool) -> Verdict | None:
        counts = self._counts()
        lacks = Completeness(
            canceled=counts.canceled, sequential=True, looks=self._looks, paired=self._paired, inner=inner
        )
        material = GateMaterial(counts, lacks, pairs=self._pairs, shares=self._shares)
        answer = combine([rule.judge(asked, material, label).verdict for rule, label, asked in self._rules])
        return answer if answer == "FAIL" or (answer == "PASS" and self._all_can_be_sure) else None

    def _counts(self) -> EpisodeCounts:
        return count_endings(self._endings)


def _drives(results: Sequence[EpisodeResult]) -> dict[Hashable, Drive]:
    """Returns what episodes came to, by their position; in which world makes no difference before the end."""
    return {at: Drive("", success(result), result.status, result.failure_code) for at, result in enumerate(results)}
