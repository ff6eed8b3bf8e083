"""The gate: whether the episodes show what its rules ask for, or the opposite, or too little.

FAIL if any rule fails, PASS if all rules pass, else INCONCLUSIVE, and more episodes are needed.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import pyarrow as pa
import pyarrow.compute as pc
from pydantic import JsonValue

from specs.base import Spec
from specs.data.episode import CANCELED
from specs.data.run_report import Verdict as Answer
from specs.pipeline.gate_section import Gate, QuantileRule
from tasks.results.gate.gate_rules import (
    Completeness,
    RuleVerdict,
    collision_rule,
    flip_rule,
    no_worse_rule,
    quantile_rule,
    success_rule,
)
from tasks.results.statistics.pairs import PAIRED_COLUMNS, Pairs
from tasks.results.statistics.success import EpisodeCounts

_WHOLE = Completeness()
_METRICS = "metrics."
_WEIGHT: tuple[Answer, ...] = ("FAIL", "INCONCLUSIVE", "PASS")
_NOT_COMPARED = frozenset({"NOT COMPARED", "NOT RUN"})


class Verdict(Spec):
    """The gate's answer, why for a person, a line for each of several rules, and the answer of each of its rules."""

    verdict: Answer
    sentence: str
    counts: EpisodeCounts
    rules: tuple[RuleVerdict, ...]


@dataclass(frozen=True)
class Material:
    """What a gate judges by.

    Attributes:
        counts: What the episodes came to; of the tested version alone, where another one is in the same batch.
        lacks: What of the batch is not there to be counted.
        rows: The columns `columns_needed` of the same episodes; None if no rule needs any.
        pairs: How the tested version compares with the other one; or why it cannot be said.
        audit: What the batch's record says of its parity audit; None if there was none.
    """

    counts: EpisodeCounts
    lacks: Completeness = _WHOLE
    rows: pa.Table | None = None
    pairs: Pairs | str = "there is no other version to compare with"
    audit: Mapping[str, JsonValue] | None = None


def judge(gate: Gate, material: Material) -> Verdict:
    """Returns the verdict on a batch."""
    rules = tuple(_answers(gate, material))
    answer = together([rule.verdict for rule in rules])
    return Verdict(verdict=answer, sentence=_told(answer, rules), counts=material.counts, rules=rules)


def together(answers: Sequence[Answer]) -> Answer:
    """Returns the answer of several rules: FAIL if any fails, PASS if all pass."""
    if "FAIL" in answers:
        return "FAIL"
    return "PASS" if answers and all(answer == "PASS" for answer in answers) else "INCONCLUSIVE"


def _told(answer: Answer, rules: Sequence[RuleVerdict]) -> str:
    """Returns a rule's sentence; of several a line each, what decided first, under one that counts them."""
    if len(rules) == 1:
        return rules[0].sentence
    by_weight = sorted(rules, key=lambda rule: _WEIGHT.index(rule.verdict))
    counts = Counter(rule.verdict for rule in by_weight)
    said = ", ".join(f"{count} {'says' if count == 1 else 'say'} {each}" for each, count in counts.items())
    return "\n".join([f"{answer}: of {len(rules)} rules, {said}", *(rule.sentence for rule in by_weight)])


def columns_needed(gate: Gate) -> list[str]:
    """Returns the columns of ``results.parquet`` that the gate's rules look at; none if counts are all they need."""
    needed: list[str] = []
    if gate.noWorseThan:
        needed += [*PAIRED_COLUMNS, "status"]
    if gate.collisionRate or gate.quantiles:
        # robot_digest, to tell the tested version from another one in the same batch
        needed += ["robot_digest", "status", "success", "collisions"]
    needed += ["metrics" if rule.column.startswith(_METRICS) else rule.column for rule in gate.quantiles or ()]
    return list(dict.fromkeys(needed))


def counted(rows: pa.Table) -> EpisodeCounts:
    """Returns what episodes came to, by their rows."""
    status = cast("list[str]", rows.column("status").to_pylist())
    success = cast("list[bool | None]", rows.column("success").to_pylist())
    canceled = status.count(CANCELED)
    return EpisodeCounts(
        episodes=len(status) - canceled,
        successes=success.count(True),
        failed_jobs=status.count("Failed"),
        canceled=canceled,
    )


def _answers(gate: Gate, material: Material) -> list[RuleVerdict]:
    lacks = material.lacks
    found: list[RuleVerdict] = []
    if gate.successRate:
        found.append(success_rule(material.counts, gate.successRate, lacks))
    if gate.noWorseThan:
        found.append(no_worse_rule(material.pairs, gate.noWorseThan, lacks))
    if gate.collisionRate:
        collided, unknown, n = _collisions(_rows(material))
        found.append(collision_rule(collided, unknown, n, gate.collisionRate, lacks))
    if gate.maxOutcomeFlipRate:
        found.append(flip_rule(*_flips(material.audit), gate.maxOutcomeFlipRate))
    for number, rule in enumerate(gate.quantiles or ()):
        values, unknown = _values(_rows(material), rule)
        found.append(quantile_rule(f"quantiles[{number}]", values, unknown, rule, lacks))
    return found


def _rows(material: Material) -> pa.Table:
    if material.rows is None:
        raise ValueError("a rule looks at columns of the results, and there are none")
    return material.rows.filter(pc.field("status") != CANCELED)


def _collisions(rows: pa.Table) -> tuple[int, int, int]:
    """Returns in how many episodes a contact began, how many others' jobs failed, and how many there are."""
    ended = zip(rows.column("status").to_pylist(), rows.column("collisions").to_pylist(), strict=True)
    kinds = [(status == "Failed", collisions > 0) for status, collisions in ended]
    collided = sum(touched for _, touched in kinds)
    return collided, sum(failed and not touched for failed, touched in kinds), len(kinds)


def _values(rows: pa.Table, rule: QuantileRule) -> tuple[list[float], int]:
    """Returns a column's values, and how many episodes have none to rely on: null, or the job failed."""
    if rule.column.startswith(_METRICS):
        name = rule.column.removeprefix(_METRICS)
        column = [dict(metrics).get(name) for metrics in rows.column("metrics").to_pylist()]
    else:
        column = rows.column(rule.column).to_pylist()
    sound = [status != "Failed" for status in rows.column("status").to_pylist()]
    known = [value for value, ended in zip(column, sound, strict=True) if ended and value is not None]
    values = [float(value) for value in known if not math.isnan(value)]
    return values, len(column) - len(values)


def _flips(audit: Mapping[str, JsonValue] | None) -> tuple[int, int, str]:
    """Returns how many episodes spread over the batch were compared, how many flipped, and why none can be counted."""
    if audit is None:
        return 0, 0, "the batch was not audited"
    if audit["verdict"] in _NOT_COMPARED:
        return 0, 0, f"the parity audit is {audit['verdict']}: {audit['sentence']}"
    if audit.get("unreproduced"):
        return 0, 0, f"the parity audit could not make all rows again: {audit['sentence']}"
    spread = cast("Mapping[str, int]", audit["spread"])
    return spread["lanes"], spread["flips"], ""
