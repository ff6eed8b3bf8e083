"""The rule ``quantiles``: a quantile of a column of the results lies where it must."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from specs.pipeline.gate_section import QuantileRule
from tasks.results.gate.rules.metric_names import PREFIX
from tasks.results.gate.rules.power_lines import power_line, worth_line
from tasks.results.gate.rules.rule import GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.sentences import (
    answer_above,
    answer_below,
    confidence_text,
    nothing_counted,
    sentence,
)
from tasks.results.statistics.intervals import Interval, quantile_interval
from tasks.results.statistics.power.shares import quantile_needs

if TYPE_CHECKING:
    import pyarrow as pa

_METRICS = "metrics"


def _columns(asked: QuantileRule) -> Sequence[str]:
    return ("status", _METRICS if asked.column.startswith(PREFIX) else asked.column)


def _judge(asked: QuantileRule, material: GateMaterial, label: str) -> RuleVerdict:
    values, unknown = _values(material.ended_rows(), asked.column)
    n = len(values) + unknown
    if not values:
        return nothing_counted(label, f"no episode has a value of {asked.column}", {"column": asked.column})
    interval = _interval(values, unknown, asked)
    at_least = asked.atLeast is not None
    bar = asked.atLeast if asked.atLeast is not None else asked.atMost or 0.0
    answer = (answer_above if at_least else answer_below)(interval, bar, n, sound=material.lacks.whole())
    of = f"the {asked.quantile:g} quantile of {asked.column} over {n} episodes"
    unseen = f", unknown in {unknown}" if unknown else ""
    estimate = sorted(values)[max(0, math.ceil(asked.quantile * len(values)) - 1)]
    seen = f"{of}{unseen} is {estimate:.4g} ({100 * asked.confidence:g} % interval {_interval_text(interval)})"
    bar_text = f"at {'least' if at_least else 'most'} {bar:g} asked for"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, bar_text, material.lacks),
        method="order statistics",
        counted=n,
        estimate=estimate,
        lower=_finite(interval.lower),
        upper=_finite(interval.upper),
        facts={"column": asked.column, "unknown": unknown},
    )


def _values(rows: "pa.Table", column: str) -> tuple[list[float], int]:
    """Returns a column's values, and how many episodes have none to rely on: null, or the job failed."""
    if column.startswith(PREFIX):
        name = column.removeprefix(PREFIX)
        found = [dict(metrics).get(name) for metrics in rows.column(_METRICS).to_pylist()]
    else:
        found = rows.column(column).to_pylist()
    sound = [status != "Failed" for status in rows.column("status").to_pylist()]
    known = [value for value, ended in zip(found, sound, strict=True) if ended and value is not None]
    values = [float(value) for value in known if not math.isnan(value)]
    return values, len(found) - len(values)


def measured_names(rows: "pa.Table") -> frozenset[str]:
    """Returns the names of all metrics that an episode has; none if no rule looks at that column."""
    if _METRICS not in rows.column_names:
        return frozenset()
    return frozenset(str(name) for metrics in rows.column(_METRICS).to_pylist() for name, _ in metrics)


def _interval(values: Sequence[float], unknown: int, asked: QuantileRule) -> Interval:
    """Returns the interval of the quantile, whatever the unknown values are."""
    worst = quantile_interval([*values, *[-math.inf] * unknown], asked.quantile, asked.confidence).lower
    best = quantile_interval([*values, *[math.inf] * unknown], asked.quantile, asked.confidence).upper
    return Interval(lower=worst, upper=best)


def _plan(asked: QuantileRule, planned: PlannedEpisodes) -> Iterator[str]:
    at_least = asked.atLeast is not None
    bar = f"at least {asked.atLeast:g}" if asked.atLeast is not None else f"at most {asked.atMost:g}"
    yield f"the {asked.quantile:g} quantile of {asked.column} {bar}, {confidence_text(asked.confidence)}"
    tail = asked.quantile if at_least else 1.0 - asked.quantile
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
