"""The gate: whether the episodes show what its rules ask for, or the opposite, or too little.

FAIL if any rule fails, PASS if all rules pass, else INCONCLUSIVE, and more episodes are needed.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from specs.base import Spec
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import Gate
from tasks.results.gate.engine_doubt import with_engine_doubt
from tasks.results.gate.rules.collision_rate import COLLISION_RATE
from tasks.results.gate.rules.no_worse_than import NO_WORSE_THAN
from tasks.results.gate.rules.outcome_flip_rate import OUTCOME_FLIP_RATE
from tasks.results.gate.rules.quantiles import QUANTILES
from tasks.results.gate.rules.rule import ColumnValues, GateMaterial, GateRule, RuleVerdict, Share, WorldShare
from tasks.results.gate.rules.success_rate import SUCCESS_RATE
from tasks.results.statistics.room_coverage import RoomCoverage
from tasks.results.statistics.success import Ending, EpisodeCounts, count_endings

if TYPE_CHECKING:
    import pyarrow as pa  # `simyard plan` asks for rules alone, and must not wait for Arrow

GATE_RULES: tuple[GateRule[Any], ...] = (SUCCESS_RATE, NO_WORSE_THAN, COLLISION_RATE, OUTCOME_FLIP_RATE, QUANTILES)
"""In the order of the fields of the document's gate section."""

# They tell the tested version from another one in the same batch, count its episodes, and say in which worlds.
_EPISODE_COLUMNS = ("robot_digest", "status", "success", "world")
_WEIGHT: tuple[Verdict, ...] = ("FAIL", "INCONCLUSIVE", "PASS")


class GateVerdict(Spec):
    """The gate's answer.

    Attributes:
        sentence: Why, for a person; a line for each of several rules.
        counts: What the judged episodes came to.
        rules: The answer of each rule.
        rooms: How much of its worlds the robots were in; None where nothing says that. It decides nothing.
        tries: How often the gate was asked before of the same version on other episodes, and did not say PASS. It
            decides nothing either.
    """

    verdict: Verdict
    sentence: str
    counts: EpisodeCounts
    rules: tuple[RuleVerdict, ...]
    rooms: RoomCoverage | None = None
    tries: int = 0


def judge(gate: Gate, material: GateMaterial) -> GateVerdict:
    """Returns the verdict on a batch."""
    counted = _counted(gate, material)
    rules = tuple(
        with_engine_doubt(rule.judge(asked, counted, label), asked, material.audit)
        for rule in GATE_RULES
        for label, asked in rule.asked(gate)
    )
    answer = combine([rule.verdict for rule in rules])
    sentence = "\n".join([_sentence(answer, rules), *_tries_line(gate, material.tries)])
    return GateVerdict(
        verdict=answer,
        sentence=sentence,
        counts=material.counts,
        rules=rules,
        rooms=material.rooms,
        tries=material.tries,
    )


def combine(answers: Sequence[Verdict]) -> Verdict:
    """Returns the answer of several rules: FAIL if any fails, PASS if all pass."""
    if "FAIL" in answers:
        return "FAIL"
    return "PASS" if answers and all(answer == "PASS" for answer in answers) else "INCONCLUSIVE"


def columns_needed(gate: Gate) -> list[str]:
    """Returns the columns of ``results.parquet`` that the gate's rules look at; none if counts are all they need."""
    needed = [name for rule in GATE_RULES for _, asked in rule.asked(gate) for name in rule.columns(asked)]
    return list(dict.fromkeys([*_EPISODE_COLUMNS, *needed])) if needed else []


def count_rows(rows: "pa.Table") -> EpisodeCounts:
    """Returns what episodes came to, by their rows."""
    failed_jobs = [status == "Failed" for status in rows.column("status").to_pylist()]
    return count_endings(Counter(map(Ending, rows.column("success").to_pylist(), failed_jobs)))


def _counted(gate: Gate, material: GateMaterial) -> GateMaterial:
    """Returns the material with what each of the gate's rules that count episodes counts in its rows."""
    if material.rows is None:
        return material
    ended, shares, by_world = material.ended_rows(), dict[str, Share](), dict[str, Sequence[WorldShare]]()
    for rule in GATE_RULES:
        for label, asked in rule.asked(gate) if rule.count else ():
            columns = rule.columns(asked)
            shares[label] = rule.count(_values(ended, columns)) if rule.count else Share()
            ours, whole = (_by_world(rule, columns, material, rows) for rows in (ended, material.rows))
            by_world[label] = [WorldShare(ours.get(world, Share()), share) for world, share in sorted(whole.items())]
    return replace(material, shares=shares, world_shares=by_world)


def _by_world(
    rule: GateRule[Any], columns: Sequence[str], material: GateMaterial, rows: "pa.Table"
) -> dict[str, Share]:
    """Returns what a rule counts in each world that has rows."""
    values, count = _values(rows, columns), rule.count
    return {
        world: count({name: [column[at] for at in places] for name, column in values.items()})
        for world, places in material.rows_by_world(rows).items()
        if count
    }


def _values(rows: "pa.Table", columns: Sequence[str]) -> ColumnValues:
    return {name: rows.column(name).to_pylist() for name in columns}


def _tries_line(gate: Gate, before: int) -> Iterator[str]:
    """Yields what earlier tries do to the chance of a false PASS, by Boole's inequality; nothing of the first try.

    A gate that ought to fail has a rule that ought to, which passes wrongly in half of its remaining doubt at most.
    """
    if before:
        each = max((1.0 - asked.confidence) / 2.0 for rule in GATE_RULES for _, asked in rule.asked(gate))
        most, tries = min(1.0, (before + 1) * each), before + 1
        chance = f"{tries} x {100 * each:.3g} % = {100 * most:.3g} %"
        yield f"try {tries} of this gate on other episodes, none passed before: a false PASS by chance up to {chance}"


def _sentence(answer: Verdict, rules: Sequence[RuleVerdict]) -> str:
    """Returns a rule's sentence; of several a line each, what decided first, under one that counts them."""
    if len(rules) == 1:
        return rules[0].sentence
    by_weight = sorted(rules, key=lambda rule: _WEIGHT.index(rule.verdict))
    counts = Counter(rule.verdict for rule in by_weight)
    said = ", ".join(f"{count} {'says' if count == 1 else 'say'} {each}" for each, count in counts.items())
    return "\n".join([f"{answer}: of {len(rules)} rules, {said}", *(rule.sentence for rule in by_weight)])
