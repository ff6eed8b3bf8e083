"""The rule ``quantiles``: a quantile of a column of the results lies where it must."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from specs.data.result_columns import COURSES
from specs.pipeline.gate_section import METRIC_PREFIX, QuantileRule
from tasks.results.gate.missing_data import ASSUMED, Assumed, Gap, gap_of, unseen
from tasks.results.gate.rules.rule import GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.rule_answers import (
    answer_above,
    answer_below,
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
from tasks.results.statistics.intervals import Interval, quantile_interval
from tasks.results.statistics.over_worlds import quantile_over_worlds, why_refused
from tasks.results.statistics.power import quantile_needs

if TYPE_CHECKING:
    import pyarrow as pa

_METRICS = "metrics"
_ENDS = ("status", "failure_code", "outcome")


def _columns(asked: QuantileRule) -> Sequence[str]:
    return (*_ENDS, _METRICS if asked.column.startswith(METRIC_PREFIX) else asked.column)


class _Values(NamedTuple):
    """What episodes measure.

    Attributes:
        seen: The values of those that have one to rely on.
        proof: A value of each episode, with what a PASS takes it for where it is not known.
        blame: The same as a FAIL takes it.
        gaps: Why others have none to rely on.
    """

    seen: list[float]
    proof: list[float]
    blame: list[float]
    gaps: Counter[Gap]

    def unknown_text(self) -> str:
        """Returns of how many episodes no value counts, and why."""
        said = ", ".join(f"{count} {_GAPS[gap]}" for gap, count in sorted(self.gaps.items()))
        return f"unknown in {self.gaps.total()} ({said})"


_GAPS: Mapping[Gap, str] = {
    "robot": "crashed by the robot's own code",
    "elsewhere": "failed otherwise",
    "canceled": "canceled",
    "no value": "without a value",
    "not passed": "did not pass",
}


def _judge(asked: QuantileRule, material: GateMaterial, label: str) -> RuleVerdict:
    lacks = material.lacks
    ended = material.ended_rows()
    found, facts = _values(ended, asked), {"column": asked.column}
    n, unknown = len(found.proof), len(found.proof) - len(found.seen)
    if not found.seen:
        why = f"{found.unknown_text()} of {n} episodes" if n else "there is no episode"
        return nothing_counted(label, f"nothing to tell {asked.column} by: {why}", facts)
    worlds = material.rows_by_world(ended)
    # The bound on the side of the bar needs two worlds' worth of its tail.
    tail = asked.quantile if asked.atLeast is not None else 1.0 - asked.quantile
    if asked.over and (why := refusal("quantile", lacks, len(worlds), tail)):
        return nothing_counted(label, why, facts)
    gone = unseen("quantiles", gaps(lacks))
    interval = _over_worlds(material, asked) if asked.over else _interval(found, asked, gone.best)
    at_least = asked.atLeast is not None
    bar = asked.atLeast if asked.atLeast is not None else asked.atMost or 0.0
    answer = (answer_above if at_least else answer_below)(interval, bar, n, sound=not gone.blocks)
    of = f"the {asked.quantile:g} quantile of {asked.column} over {n} episodes{where_text(len(worlds), asked.over)}"
    unseen_text = f", {found.unknown_text()}," if unknown else ""
    estimate = sorted(found.seen)[max(0, math.ceil(asked.quantile * len(found.seen)) - 1)]
    known_text, counted_text = (" where it is known", ", unknown ones counted,") if unknown else ("", "")
    within = f"{100 * asked.confidence:g} % interval{counted_text} {_interval_text(interval)}"
    seen = f"{of}{unseen_text} is {estimate:.4g}{known_text} ({within})"
    bar_text = f"at {'least' if at_least else 'most'} {bar:g} asked for"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, bar_text, lacks),
        method="order statistics over worlds" if asked.over else "order statistics",
        counted=n,
        estimate=estimate,
        lower=_finite(interval.lower),
        upper=_finite(interval.upper),
        facts={**facts, "unknown": unknown, **({"worlds": len(worlds)} if worlds else {})},
    )


def _values(rows: "pa.Table", asked: QuantileRule) -> _Values:
    """Returns what the episodes of a column measure, as the table of missing data has it."""
    worst = -math.inf if asked.atLeast is not None else math.inf
    measured, found = _measured(rows, asked.column), _Values([], [], [], Counter())
    ends = zip(*(rows.column(name).to_pylist() for name in _ENDS), strict=True)
    for value, (status, code, outcome) in zip(measured, ends, strict=True):
        gap = _gap(asked, value, gap_of(status, code), outcome)
        if gap is None:
            taken = Assumed("seen", "seen")
            found.seen.append(value)
        else:
            found.gaps[gap] += 1
            taken = ASSUMED["failed: worst" if asked.failed else "quantiles"][gap]
        values: Mapping[str, float] = {"seen": value, "worst": worst, "best": -worst, "blocks": worst}
        found.proof.append(values[taken.proof])
        found.blame.append(values[taken.blame])
    return found


def _gap(asked: QuantileRule, value: float, gap: Gap | None, outcome: str) -> Gap | None:
    """Returns why a value is not to be relied on; None if it is."""
    if gap is not None:
        return gap
    if not math.isfinite(value):
        return "no value"
    return "not passed" if outcome != "Passed" and (asked.failed or _is_made_better(asked)) else None


def _is_made_better(asked: QuantileRule) -> bool:
    """Returns whether an end that came early may make the measure look better; of a scenario's own nobody knows."""
    if asked.column.startswith(METRIC_PREFIX):
        return True
    return COURSES.get(asked.column, "") == ("falls" if asked.atLeast is not None else "grows")


def _measured(rows: "pa.Table", column: str) -> list[float]:
    """Returns the values of a column; NaN where there is none."""
    if column.startswith(METRIC_PREFIX):
        name = column.removeprefix(METRIC_PREFIX)
        found = [dict(metrics or ()).get(name) for metrics in rows.column(_METRICS).to_pylist()]
    else:
        found = rows.column(column).to_pylist()
    return [math.nan if value is None else float(value) for value in found]


def measured_names(rows: "pa.Table") -> frozenset[str]:
    """Returns the names of all metrics that an episode has; none if no rule looks at that column."""
    if _METRICS not in rows.column_names:
        return frozenset()
    return frozenset(str(name) for metrics in rows.column(_METRICS).to_pylist() for name, _ in metrics)


def _interval(found: _Values, asked: QuantileRule, best: int) -> Interval:
    """Returns the interval of the quantile, whatever the unknown values are; as many more are the best for a FAIL."""
    at_least = asked.atLeast is not None
    blame = [*found.blame, *[math.inf if at_least else -math.inf] * best]
    low, high = (found.proof, blame) if at_least else (blame, found.proof)
    return Interval(
        lower=quantile_interval(low, asked.quantile, asked.confidence).lower,
        upper=quantile_interval(high, asked.quantile, asked.confidence).upper,
    )


def _over_worlds(material: GateMaterial, asked: QuantileRule) -> Interval:
    """Returns the interval in worlds like these; unknown values are tried as by `rates.over_worlds`."""
    rows = material.every_row()
    found, worlds = _values(rows, asked), list(material.rows_by_world(rows).values())
    unknown = [sum(found.proof[at] != found.blame[at] for at in places) for places in worlds]
    intervals = [
        quantile_over_worlds(
            [
                [(found.blame if best else found.proof)[at] for at in places]
                for places, best in zip(worlds, cut, strict=True)
            ],
            asked.quantile,
            asked.confidence,
        )
        for values in (found.proof, found.blame)
        for cut in cuts(unknown, [_share_within(asked, [values[at] for at in places]) for places in worlds])
    ]
    return Interval(lower=min(each.lower for each in intervals), upper=max(each.upper for each in intervals))


def _share_within(asked: QuantileRule, values: Sequence[float]) -> float:
    """Returns the share of a world's values that are on the right side of the bar, by which worlds are ranked."""
    at_least, bar = asked.atLeast is not None, asked.atLeast if asked.atLeast is not None else asked.atMost or 0.0
    return sum(value >= bar if at_least else value <= bar for value in values) / len(values)


def _plan(asked: QuantileRule, planned: PlannedEpisodes) -> Iterator[str]:
    at_least = asked.atLeast is not None
    bar = f"at least {asked.atLeast:g}" if asked.atLeast is not None else f"at most {asked.atMost:g}"
    yield f"the {asked.quantile:g} quantile of {asked.column} {bar}, {confidence_text(asked.confidence)}"
    tail = asked.quantile if at_least else 1.0 - asked.quantile
    if asked.over and (why := why_refused("quantile", planned.worlds, tail)):
        yield f"will be INCONCLUSIVE: {why}"
        return
    for share in (0.0, tail / 2.0):
        needs = quantile_needs(tail, asked.confidence, share, planned.episodes)
        yield from power_line(f"if {100 * share:g} % are beyond", needs, planned.episodes)
    if asked.over == "worlds":
        yield worth_line(planned)


def _interval_text(interval: Interval) -> str:
    if math.isinf(interval.lower) and math.isinf(interval.upper):
        return "open, too few episodes"
    if math.isinf(interval.lower):
        return f"up to {interval.upper:.4g}"
    if math.isinf(interval.upper):
        return f"from {interval.lower:.4g}"
    return f"{interval.lower:.4g} to {interval.upper:.4g}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


QUANTILES = GateRule("quantiles", _judge, _plan, _columns)
