"""The gate: whether the episodes show what its rules ask for, or the opposite, or too little.

FAIL if any rule fails, PASS if all rules pass, else INCONCLUSIVE, and more episodes are needed. A gate may be asked at
each look at its batch (`tasks.results.statistics.interim_analyses` says why one may).

The engine has a part in a gate's doubt: what passes by the batch's engine, and fails on C MuJoCo. A few audited lanes
never show that an engine is without fault: of 32 without a false pass up to 11 % may be false. Were that taken off
every rate, no gate would ever pass. So doubt counts where there is reason for it: where the parity audit saw a pass
that fails on C MuJoCo, which C MuJoCo does not flip by itself, and chance does not explain. Then its uncertainty and
that of the rate are joined, and an answer that does not stand it is INCONCLUSIVE (docs/decisions/0028).
"""

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, cast

from specs.base import Spec
from specs.data.episode import CANCELED, EpisodeResult, success
from specs.data.parity_audit import AuditReport, FlipShare
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import SEQUENTIAL_RULES, CollisionRate, Gate, SuccessRate
from tasks.results.gate.impossible_rows import impossible_rows
from tasks.results.gate.rules.collision_rate import COLLISION_RATE
from tasks.results.gate.rules.no_worse_than import NO_WORSE_THAN
from tasks.results.gate.rules.outcome_flip_rate import OUTCOME_FLIP_RATE
from tasks.results.gate.rules.quantiles import QUANTILES
from tasks.results.gate.rules.rare_failure import RARE_FAILURE
from tasks.results.gate.rules.rule import (
    ColumnValues,
    Completeness,
    GateMaterial,
    GateRule,
    RuleVerdict,
    Share,
    WorldShare,
)
from tasks.results.gate.rules.rule_answers import nothing_counted
from tasks.results.gate.rules.success_rate import SUCCESS_RATE
from tasks.results.gate.version_pairs import Drive, PairCounts, count_pairs
from tasks.results.statistics.batch_summary import Ending, EpisodeCounts, count_endings, ending_of
from tasks.results.statistics.intervals import Stratum, discounted_bound, stratum_interval
from tasks.results.statistics.room_coverage import RoomCoverage

if TYPE_CHECKING:
    import pyarrow as pa  # `simyard plan` asks for rules alone, and must not wait for Arrow

GATE_RULES: tuple[GateRule[Any], ...] = (
    SUCCESS_RATE,
    NO_WORSE_THAN,
    COLLISION_RATE,
    OUTCOME_FLIP_RATE,
    QUANTILES,
    RARE_FAILURE,
)
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
        attempts: Of each earlier attempt, on other episodes of the same version and without a PASS, how often it passes
            wrongly by chance. It decides nothing either.
    """

    verdict: Verdict
    sentence: str
    counts: EpisodeCounts
    rules: tuple[RuleVerdict, ...]
    rooms: RoomCoverage | None = None
    attempts: tuple[float, ...] = ()


def judge(gate: Gate, material: GateMaterial) -> GateVerdict:
    """Returns the verdict on a batch; none of one that has rows that cannot be."""
    if material.rows is not None and (why := impossible_rows(material.rows)):
        return _not_judged(gate, material, why)
    counted = _counted(gate, material)
    rules = tuple(
        with_engine_doubt(rule.judge(asked, counted, label), asked, material.audit)
        for rule in GATE_RULES
        for label, asked in rule.asked(gate)
    )
    answer = combine([rule.verdict for rule in rules])
    sentence = "\n".join([_sentence(answer, rules), *_attempts_line(gate, material.attempts)])
    return GateVerdict(
        verdict=answer,
        sentence=sentence,
        counts=material.counts,
        rules=rules,
        rooms=material.rooms,
        attempts=material.attempts,
    )


def _not_judged(gate: Gate, material: GateMaterial, why: str) -> GateVerdict:
    """Returns that nothing was judged, since rows cannot be; no rule says anything of them then."""
    said = f"NOT JUDGED: {why}: nothing ships by such rows; look at one of them with simyard replay"
    rules = [nothing_counted(label, said) for rule in GATE_RULES for label, _ in rule.asked(gate)]
    return GateVerdict(
        verdict="INCONCLUSIVE",
        sentence=f"INCONCLUSIVE: {said}",
        counts=material.counts,
        rules=tuple(rules),
        rooms=material.rooms,
        attempts=material.attempts,
    )


def combine(answers: Sequence[Verdict]) -> Verdict:
    """Returns the answer of several rules: FAIL if any fails, PASS if all pass."""
    if "FAIL" in answers:
        return "FAIL"
    return "PASS" if answers and all(answer == "PASS" for answer in answers) else "INCONCLUSIVE"


def false_pass_chance(gate: Gate) -> float:
    """Returns how often a gate that ought to fail passes by chance, at most.

    It has a rule that ought to fail, which passes wrongly in half of its remaining doubt at most.
    """
    return round(max((1.0 - asked.confidence) / 2.0 for rule in GATE_RULES for _, asked in rule.asked(gate)), 9)


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


def _attempts_line(gate: Gate, before: Sequence[float]) -> Iterator[str]:
    """Yields what earlier attempts do to the chance of a false PASS, by Boole's inequality; nothing of the first."""
    if before:
        errors = Counter([*before, false_pass_chance(gate)])
        terms = " + ".join(f"{count} x {100 * error:.3g} %" for error, count in sorted(errors.items()))
        chance = f"{terms} = {100 * min(1.0, sum(errors.elements())):.3g} %"
        attempt = len(before) + 1
        yield f"try {attempt} of this gate on other episodes, none passed before: a false PASS by chance up to {chance}"


def _sentence(answer: Verdict, rules: Sequence[RuleVerdict]) -> str:
    """Returns a rule's sentence; of several a line each, what decided first, under one that counts them."""
    if len(rules) == 1:
        return rules[0].sentence
    by_weight = sorted(rules, key=lambda rule: _WEIGHT.index(rule.verdict))
    counts = Counter(rule.verdict for rule in by_weight)
    said = ", ".join(f"{count} {'says' if count == 1 else 'say'} {each}" for each, count in counts.items())
    return "\n".join([f"{answer}: of {len(rules)} rules, {said}", *(rule.sentence for rule in by_weight)])


DOUBT_CHANCE = 0.2
"""How likely chance may give so many flips, for them to count; a reason for doubt needs less than an accusation."""
Direction = Literal["false_passes", "missed_contacts"]


class EngineDoubt(Spec):
    """How much of what went well by the batch's engine may not go well on C MuJoCo.

    Attributes:
        flips: Audited lanes that did not, and that C MuJoCo does not flip by itself.
        lanes: Audited lanes.
        rate: Their share, weighted, 0-1.
        upper: The upper bound of it.
    """

    flips: int
    lanes: int
    rate: float
    upper: float


def engine_doubt(audit: AuditReport | None, direction: Direction, confidence: float) -> EngineDoubt | None:
    """Returns the doubt that an audit gives reason for; None if it gives none.

    Args:
        audit: As the batch's record has it; None if there was none.
        direction: Passes that fail on C MuJoCo, or episodes without a contact that have one there.
        confidence: Coverage of the interval, between 0 and 1.
    """
    if audit is None:
        return None
    share: FlipShare = getattr(audit, direction)
    if not share.beyond or (share.chance is not None and share.chance >= DOUBT_CHANCE):
        return None
    bounds = stratum_interval(Stratum(share.episodes, share.effective, share.beyond), confidence)
    return EngineDoubt(flips=share.unexplained, lanes=share.lanes, rate=share.beyond, upper=bounds.upper)


def with_engine_doubt(answer: RuleVerdict, asked: Spec, audit: AuditReport | None) -> RuleVerdict:
    """Returns a rule's answer, its interval widened by what may be the engine's; only a PASS can change, to less.

    Args:
        answer: The rule's own answer.
        asked: What the document asks for.
        audit: As the batch's record has it; None if there was none.
    """
    if answer.verdict != "PASS" or answer.estimate is None or answer.lower is None or answer.upper is None:
        return answer
    match asked:
        case SuccessRate():
            doubt = engine_doubt(audit, "false_passes", asked.confidence)
            if doubt is None:
                return answer
            lower = discounted_bound(answer.estimate, answer.lower, doubt.rate, doubt.upper)
            said = f"up to {_points_text(answer.estimate * doubt.upper)} points of these passes may be the engine's"
            seen = f"{doubt.flips} of {doubt.lanes} audited passes fail on C MuJoCo, and no micrometre explains it"
            return _changed(answer, {"lower": lower}, f"{said}: {seen}", stands=lower >= asked.atLeast)
        case CollisionRate():
            doubt = engine_doubt(audit, "missed_contacts", asked.confidence)
            if doubt is None:
                return answer
            upper = 1.0 - discounted_bound(1.0 - answer.estimate, 1.0 - answer.upper, doubt.rate, doubt.upper)
            said = f"up to {_points_text((1.0 - answer.estimate) * doubt.upper)} points more may collide on C MuJoCo"
            seen = f"{doubt.flips} of {doubt.lanes} audited episodes without a contact have one there"
            return _changed(answer, {"upper": upper}, f"{said}: {seen}", stands=upper <= asked.atMost)
        case _:
            return answer


def _points_text(share: float) -> str:
    return f"{100 * share:.1f}"


def _changed(answer: RuleVerdict, bound: Mapping[str, float], why: str, *, stands: bool) -> RuleVerdict:
    verdict: Verdict = "PASS" if stands else "INCONCLUSIVE"
    ((name, value),) = bound.items()
    before = cast("float", getattr(answer, name))
    return answer.model_copy(
        update={
            **bound,
            "verdict": verdict,
            "sentence": f"{verdict}{answer.sentence.removeprefix(answer.verdict)}; {why}",
            "facts": {**answer.facts, "engine_doubt": abs(value - before)},
        }
    )


_PAIRED = "noWorseThan"


# ``tasks.results.statistics.interim_analyses`` says why one may ask after each chunk.
class InterimGate:
    """Counts a batch's episodes as they end, for the rules that can be sure early."""

    def __init__(self, gate: Gate, looks: tuple[int, ...], *, paired: bool = False) -> None:
        """Begins to count.

        Args:
            gate: What is asked for.
            looks: After how many episodes it is asked, the last being all of them.
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
        return self._answer(inner=False) if self._answer(inner=True) else None

    def stands(self, audit: AuditReport | None) -> bool:
        """Returns whether a PASS stays one where an audit of the episodes so far gives reason to doubt the engine.

        Args:
            audit: As the batch's record would have it; None if there was none.
        """
        sections = [asked for _, _, asked in self._rules]
        answers = zip(self._judged(inner=False), sections, strict=True)
        return combine([with_engine_doubt(answer, asked, audit).verdict for answer, asked in answers]) == "PASS"

    def _answer(self, *, inner: bool) -> Verdict | None:
        answer = combine([found.verdict for found in self._judged(inner=inner)])
        return answer if answer == "FAIL" or (answer == "PASS" and self._all_can_be_sure) else None

    def _judged(self, *, inner: bool) -> list[RuleVerdict]:
        counts = self._counts()
        lacks = Completeness(canceled=counts.canceled, looks=self._looks, paired=self._paired, inner=inner)
        material = GateMaterial(counts, lacks, pairs=self._pairs, shares=self._shares)
        return [rule.judge(asked, material, label) for rule, label, asked in self._rules]

    def _counts(self) -> EpisodeCounts:
        return count_endings(self._endings)


def _drives(results: Sequence[EpisodeResult]) -> dict[Hashable, Drive]:
    """Returns what episodes came to, by their position; in which world makes no difference before the end."""
    return {at: Drive("", success(result), result.status, result.failure_code) for at, result in enumerate(results)}
