"""The rule ``noWorseThan``: the tested version passes as often as another one on the same episodes, less a margin."""

import math
from collections.abc import Iterator, Sequence

from specs.pipeline.gate_section import NoWorseThan
from tasks.results.gate.rules.power_lines import power_line, worth_line
from tasks.results.gate.rules.rule import Completeness, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.sentences import AT_LOOKS, answer_above, confidence_text, nothing_counted, sentence
from tasks.results.statistics.intervals import Interval, mcnemar, paired_difference
from tasks.results.statistics.looks.paired_looks import paired_interval
from tasks.results.statistics.pairs import PairCounts
from tasks.results.statistics.power.paired import pair_needs

_EXPECTED_DISAGREEMENT = (0.0, 0.02, 0.05)


def _columns(_: NoWorseThan) -> Sequence[str]:
    # They tell the tested version's episodes from the other one's, in the same batch.
    return ("robot_digest", "status", "success")


def _judge(asked: NoWorseThan, material: GateMaterial, label: str) -> RuleVerdict:
    pairs, lacks = material.pairs, material.lacks
    if isinstance(pairs, str) or pairs.n == 0:
        return nothing_counted(label, pairs if isinstance(pairs, str) else "no episode of both versions is the same")
    interval, method = _interval(pairs, asked.confidence, lacks)
    sound = lacks.all_counted() if method == AT_LOOKS else lacks.whole()
    answer = answer_above(interval, -asked.margin, pairs.n, sound=sound)
    estimate = (pairs.gains - pairs.losses) / pairs.n
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    seen = (
        f"against version {asked.applicationVersion} on the same {pairs.n} episodes, {pairs.gains} that failed pass "
        f"now and {pairs.losses} that passed fail now: {100 * estimate:+.1f} points "
        f"({100 * asked.confidence:g} % {'interval at any look' if method == AT_LOOKS else 'interval'} "
        f"{lower:+.1f} to {upper:+.1f})"
    )
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, f"at most {100 * asked.margin:g} points worse asked for", lacks),
        method=method,
        counted=pairs.n,
        estimate=estimate,
        lower=interval.lower,
        upper=interval.upper,
        facts={
            "gains": pairs.gains,
            "losses": pairs.losses,
            "unpaired": pairs.unpaired,
            "mcnemar_p": float(f"{mcnemar(pairs.gains, pairs.losses):.6g}"),
        },
    )


def _interval(pairs: PairCounts, confidence: float, lacks: Completeness) -> tuple[Interval, str]:
    """Returns the interval of the difference, and what it is called; at a look, whatever the missing pairs would be."""
    if not (lacks.sequential and lacks.looks and lacks.paired):
        return paired_difference(pairs.gains, pairs.losses, pairs.n, confidence), "Tango"
    whole = lacks.look(pairs.n + pairs.unpaired)
    lack = whole - pairs.n
    lower = paired_interval(pairs.gains, pairs.losses + lack, whole, lacks.looks, confidence).lower
    upper = paired_interval(pairs.gains + lack, pairs.losses, whole, lacks.looks, confidence).upper
    return Interval(lower=lower, upper=upper), AT_LOOKS


def _plan(asked: NoWorseThan, planned: PlannedEpisodes) -> Iterator[str]:
    points = f"at most {100 * asked.margin:g} points worse than version {asked.applicationVersion}"
    yield f"{points}, {confidence_text(asked.confidence)}"
    if planned.no_baseline:
        yield f"will be INCONCLUSIVE: {planned.no_baseline}"
        return

    for share in _EXPECTED_DISAGREEMENT:
        needs = pair_needs(asked.margin, asked.confidence, share, planned.pairs)
        case = f"if equal, and {100 * share:g} % end otherwise"
        yield from power_line(case, needs, planned.pairs, "driven by both")
    if asked.over == "worlds":
        yield worth_line(planned)


NO_WORSE_THAN = GateRule("noWorseThan", _judge, _plan, _columns)
