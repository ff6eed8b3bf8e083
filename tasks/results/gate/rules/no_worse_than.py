"""The rule ``noWorseThan``: the tested version passes as often as another one on the same episodes, less a margin."""

import math
from collections.abc import Iterator, Sequence

from specs.pipeline.gate_section import NoWorseThan
from tasks.results.gate.missing_data import unseen
from tasks.results.gate.rules.rule import Completeness, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.rule_answers import (
    AT_LOOKS,
    answer_above,
    confidence_text,
    cuts,
    gaps,
    nothing_counted,
    power_line,
    refusal,
    sentence,
    where_text,
    worth_line,
)
from tasks.results.gate.version_pairs import PairCounts, WorldPairs
from tasks.results.statistics.interim_analyses import paired_interval
from tasks.results.statistics.intervals import Interval, mcnemar, paired_difference
from tasks.results.statistics.over_worlds import difference_over_worlds
from tasks.results.statistics.power import pair_needs

_EXPECTED_DISAGREEMENT = (0.0, 0.02, 0.05)


def _columns(_: NoWorseThan) -> Sequence[str]:
    # They tell the tested version's episodes from the other one's, in the same batch.
    return ("robot_digest", "status", "success")


def _judge(asked: NoWorseThan, material: GateMaterial, label: str) -> RuleVerdict:
    pairs, lacks = material.pairs, material.lacks
    if isinstance(pairs, str) or pairs.n == 0:
        return nothing_counted(label, pairs if isinstance(pairs, str) else "no episode of both versions is the same")
    why = refusal("difference", lacks, pairs.driven_worlds()) if asked.over else ""
    if why:
        return nothing_counted(label, why)
    at_looks = lacks.sequential and lacks.paired
    # Where both versions were looked at together, what was left out was not needed, and nothing is assumed of it.
    gone = unseen("noWorseThan", gaps(lacks._replace(left_out=0) if at_looks else lacks))
    interval, method = _interval(pairs, asked, lacks, gone.best, at_looks=at_looks)
    answer = answer_above(interval, -asked.margin, pairs.n, sound=not gone.blocks)
    bar = f"at most {100 * asked.margin:g} points worse asked for"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, _seen(asked, pairs, interval, method), bar, lacks),
        method=method,
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
            **({"worlds": pairs.driven_worlds()} if pairs.worlds else {}),
        },
    )


def _seen(asked: NoWorseThan, pairs: PairCounts, interval: Interval, method: str) -> str:
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    unknown = f", {pairs.unknown} more without an outcome of both" if pairs.unknown else ""
    return (
        f"against version {asked.applicationVersion} on the same {pairs.n} episodes"
        f"{where_text(pairs.driven_worlds(), asked.over)}{unknown}, "
        f"{pairs.gains} that failed pass now and {pairs.losses} "
        f"that passed fail now: {100 * (pairs.gains - pairs.losses) / pairs.n:+.1f} points "
        f"({100 * asked.confidence:g} % {'interval at any look' if method == AT_LOOKS else 'interval'} "
        f"{lower:+.1f} to {upper:+.1f})"
    )


def _interval(
    pairs: PairCounts, asked: NoWorseThan, lacks: Completeness, best: int, *, at_looks: bool
) -> tuple[Interval, str]:
    """Returns the interval of the difference, whatever the unknown ends are, and what it is called.

    Args:
        pairs: What the two versions came to.
        asked: What the document asks for.
        lacks: What is not among the pairs.
        best: How many pairs more count as gains before a FAIL.
        at_looks: Whether the batch may have been ended by these pairs, at a look.
    """
    confidence, every = asked.confidence, pairs.total()
    if asked.over:
        return _over_worlds(pairs.worlds, confidence), "Dirichlet-multinomial over worlds"
    if not at_looks:
        lower = paired_difference(every.gains, every.losses, every.n, confidence).lower
        upper = paired_difference(every.gains_at_best + best, every.losses_at_best, every.n + best, confidence).upper
        return Interval(lower=lower, upper=upper), "Tango"
    whole = lacks.look(every.n + pairs.unpaired)
    lack = whole - every.n
    lower = paired_interval(every.gains, every.losses + lack, whole, lacks.looks, confidence).lower
    upper = paired_interval(every.gains_at_best + lack, every.losses_at_best, whole, lacks.looks, confidence).upper
    return Interval(lower=lower, upper=upper), AT_LOOKS


def _over_worlds(worlds: Sequence[WorldPairs], confidence: float) -> Interval:
    """Returns the interval in worlds like these; unknown ends are tried as by `rates.over_worlds`."""
    n = [each.n + each.canceled for each in worlds]
    worst = [(each.gains, each.losses + each.canceled) for each in worlds]
    best = [(each.gains_at_best + each.canceled, each.losses_at_best) for each in worlds]
    found: list[Interval] = []
    for ends in (worst, best):
        seen = [(gains - losses) / pairs for (gains, losses), pairs in zip(ends, n, strict=True)]
        for cut in cuts([each.unknown() for each in worlds], seen):
            taken = [good if high else bad for bad, good, high in zip(worst, best, cut, strict=True)]
            gains, losses = ([each[at] for each in taken] for at in (0, 1))
            found.append(difference_over_worlds(gains, losses, n, confidence))
    return Interval(lower=min(each.lower for each in found), upper=max(each.upper for each in found))


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
