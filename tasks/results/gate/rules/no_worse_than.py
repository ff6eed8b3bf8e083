"""The rule ``noWorseThan``: the tested version passes as often as another one on the same episodes, less a margin."""

import math
from collections.abc import Iterator, Sequence

from specs.pipeline.gate_section import NoWorseThan
from tasks.results.gate.rules.missing import unseen
from tasks.results.gate.rules.pair_counts import PairCounts, WorldPairs
from tasks.results.gate.rules.rates import cuts, gaps, refusal, where_text
from tasks.results.gate.rules.rule import GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.sentences import answer_above, confidence_text, needed_line, nothing_counted, sentence
from tasks.results.statistics.intervals import Interval, mcnemar, paired_difference
from tasks.results.statistics.power.episodes_needed import pairs_needed
from tasks.results.statistics.worlds.difference_over_worlds import difference_over_worlds

_EXPECTED_DISAGREEMENT = (0.0, 0.02, 0.1)


def _columns(_: NoWorseThan) -> Sequence[str]:
    # They tell the tested version's episodes from the other one's, in the same batch.
    return ("robot_digest", "status", "success")


def _judge(asked: NoWorseThan, material: GateMaterial, label: str) -> RuleVerdict:
    pairs, lacks = material.pairs, material.lacks
    if isinstance(pairs, str) or pairs.n == 0:
        return nothing_counted(label, pairs if isinstance(pairs, str) else "no episode of both versions is the same")
    why = refusal("difference", lacks, len(pairs.worlds)) if asked.over else ""
    if why:
        return nothing_counted(label, why)
    interval = _interval(pairs, asked, unseen("noWorseThan", {"no result": lacks.missing}).best)
    sound = not unseen("noWorseThan", gaps(lacks)).blocks
    answer = answer_above(interval, -asked.margin, pairs.n, sound=sound)
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(
            answer, _seen(asked, pairs, interval), f"at most {100 * asked.margin:g} points worse asked for", lacks
        ),
        method="Dirichlet-multinomial over worlds" if asked.over else "Tango",
        counted=pairs.n,
        estimate=(pairs.gains - pairs.losses) / pairs.n,
        lower=interval.lower,
        upper=interval.upper,
        facts={
            "gains": pairs.gains,
            "losses": pairs.losses,
            "unpaired": pairs.unpaired,
            "unknown": pairs.unknown,
            "mcnemar_p": float(f"{mcnemar(pairs.gains, pairs.losses):.6g}"),
            **({"worlds": len(pairs.worlds)} if pairs.worlds else {}),
        },
    )


def _seen(asked: NoWorseThan, pairs: PairCounts, interval: Interval) -> str:
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    unknown = f", {pairs.unknown} more without an outcome of both" if pairs.unknown else ""
    return (
        f"against version {asked.applicationVersion} on the same {pairs.n} episodes"
        f"{where_text(len(pairs.worlds), asked.over)}{unknown}, {pairs.gains} that failed pass now and {pairs.losses} "
        f"that passed fail now: {100 * (pairs.gains - pairs.losses) / pairs.n:+.1f} points "
        f"({100 * asked.confidence:g} % interval {lower:+.1f} to {upper:+.1f})"
    )


def _interval(pairs: PairCounts, asked: NoWorseThan, best: int) -> Interval:
    """Returns the interval of the difference, whatever the unknown ends are; as many more are gains for a FAIL."""
    if asked.over:
        return _over_worlds(pairs.worlds, asked.confidence)
    every = pairs.total()
    lower = paired_difference(every.gains, every.losses, every.n, asked.confidence).lower
    upper = paired_difference(every.gains_at_best + best, every.losses_at_best, every.n + best, asked.confidence).upper
    return Interval(lower=lower, upper=upper)


def _over_worlds(worlds: Sequence[WorldPairs], confidence: float) -> Interval:
    """Returns the interval in worlds like these; unknown ends are tried as by `rates.over_worlds`."""
    unknown = [abs(each.gains_at_best - each.gains) + abs(each.losses - each.losses_at_best) for each in worlds]
    seen = [(each.gains - each.losses) / each.n for each in worlds]
    found = [
        difference_over_worlds(
            [each.gains_at_best if high else each.gains for each, high in zip(worlds, cut, strict=True)],
            [each.losses_at_best if high else each.losses for each, high in zip(worlds, cut, strict=True)],
            [each.n for each in worlds],
            confidence,
        )
        for cut in cuts(unknown, seen)
    ]
    return Interval(lower=min(each.lower for each in found), upper=max(each.upper for each in found))


def _plan(asked: NoWorseThan, planned: PlannedEpisodes) -> Iterator[str]:
    points = f"at most {100 * asked.margin:g} points worse than version {asked.applicationVersion}"
    yield f"{points}, {confidence_text(asked.confidence)}"
    if planned.no_baseline:
        yield f"will be INCONCLUSIVE: {planned.no_baseline}"
        return
    for share in _EXPECTED_DISAGREEMENT:
        needed = pairs_needed(asked.margin, asked.confidence, share)
        case = f"if equal, and {100 * share:g} % end otherwise"
        yield from needed_line(case, needed, planned.pairs, " driven by both")


NO_WORSE_THAN = GateRule("noWorseThan", _judge, _plan, _columns)
