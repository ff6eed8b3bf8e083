"""The rule ``collisionRate``: few enough robots touch anything."""

from collections.abc import Iterator, Sequence

from specs.pipeline.gate_section import CollisionRate
from tasks.results.gate.missing_data import ASSUMED, gap_of
from tasks.results.gate.rules.rule import ColumnValues, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict, Share
from tasks.results.gate.rules.rule_answers import (
    about,
    answer_below,
    confidence_text,
    nothing_counted,
    rate_of,
    rate_text,
    sentence,
    share_lines,
)

_COLUMNS = ("status", "failure_code", "collisions")
_EXPECTED_RATES = (0.0, 0.02, 0.05)


def _columns(_: CollisionRate) -> Sequence[str]:
    return _COLUMNS


def _count(values: ColumnValues) -> Share:
    """Returns in how many episodes a contact began; the table of missing data says which might have had one."""
    touched = unknown = 0
    for status, code, collisions in zip(*(values[name] for name in _COLUMNS), strict=True):
        gap, contact = gap_of(status, code), collisions > 0
        if gap is None or (contact and ASSUMED["collisionRate"][gap].blame == "seen"):
            touched += contact
        else:
            unknown += 1
    return Share(touched, unknown, len(values["status"]))


def _judge(asked: CollisionRate, material: GateMaterial, label: str) -> RuleVerdict:
    share = material.shares[label]
    if share.n == 0:
        return nothing_counted(label, "no episode has a result to count")
    found = rate_of(asked, "collisionRate", share, material, label)
    if isinstance(found, str):
        return nothing_counted(label, found)
    answer = answer_below(found.interval, asked.atMost, share.n, sound=not found.blocks)
    more = f", {share.unknown} more of jobs that failed" if share.unknown else ""
    text = rate_text(share.shown / share.n, found.interval, asked.confidence, found.method)
    seen = f"collisions in {share.shown} of {share.n} episodes{found.where}{more} ({text})"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, f"at most {100 * asked.atMost:g} % asked for", material.lacks, found.note),
        method=found.method,
        counted=share.n,
        estimate=share.shown / share.n,
        lower=found.interval.lower,
        upper=found.interval.upper,
        facts={"collided": share.shown, "unknown": share.unknown, **found.facts},
    )


def _plan(asked: CollisionRate, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"at most {100 * asked.atMost:g} % collide{about(asked.over)}, {confidence_text(asked.confidence)}"
    over = asked.over == "worlds"
    for rate in _EXPECTED_RATES:
        case = f"if {100 * rate:g} % collide"
        yield from share_lines(case, planned, 1.0 - asked.atMost, asked.confidence, 1.0 - rate, over_worlds=over)


COLLISION_RATE = GateRule("collisionRate", _judge, _plan, _columns, _count)
