"""The rule ``collisionRate``: few enough robots touch anything."""

from collections.abc import Iterator, Sequence

from specs.pipeline.gate_section import CollisionRate
from tasks.results.gate.rules.power_lines import share_lines
from tasks.results.gate.rules.rule import ColumnValues, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict, Share
from tasks.results.gate.rules.sentences import (
    about,
    answer_below,
    confidence_text,
    nothing_counted,
    rate_text,
    sentence,
    share_interval,
)
from tasks.results.statistics.intervals import Interval

_EXPECTED_RATES = (0.0, 0.02, 0.05)


def _columns(_: CollisionRate) -> Sequence[str]:
    return ("status", "collisions")


def _count(values: ColumnValues) -> Share:
    """Returns in how many episodes a contact began; a job that failed without one might have had one."""
    touched = [collisions > 0 for collisions in values["collisions"]]
    unknown = sum(status == "Failed" and not contact for status, contact in zip(values["status"], touched, strict=True))
    return Share(sum(touched), unknown, len(touched))


def _judge(asked: CollisionRate, material: GateMaterial, label: str) -> RuleVerdict:
    (collided, unknown, n), lacks = material.shares[label], material.lacks
    if n == 0:
        return nothing_counted(label, "no episode has a result to count")
    best, method = share_interval(collided, n, asked.confidence, lacks)
    worst, _ = share_interval(collided + unknown, n, asked.confidence, lacks)
    interval = Interval(lower=best.lower, upper=worst.upper)
    answer = answer_below(interval, asked.atMost, n, sound=lacks.all_counted())
    more = f", {unknown} more of jobs that failed" if unknown else ""
    text = rate_text(collided / n, interval, asked.confidence, method)
    seen = f"collisions in {collided} of {n} episodes{more} ({text})"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, f"at most {100 * asked.atMost:g} % asked for", lacks),
        method=method,
        counted=n,
        estimate=collided / n,
        lower=interval.lower,
        upper=interval.upper,
        facts={"collided": collided, "unknown": unknown},
    )


def _plan(asked: CollisionRate, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"at most {100 * asked.atMost:g} % collide{about(asked.over)}, {confidence_text(asked.confidence)}"
    over = asked.over == "worlds"
    for rate in _EXPECTED_RATES:
        case = f"if {100 * rate:g} % collide"
        yield from share_lines(case, planned, 1.0 - asked.atMost, asked.confidence, 1.0 - rate, over_worlds=over)


COLLISION_RATE = GateRule("collisionRate", _judge, _plan, _columns, _count)
