"""What `simyard plan` says of a gate: its rules, and how many episodes each needs."""

from collections.abc import Iterator

from flows.preview.baseline_plan import Judged
from specs.pipeline.gate_section import Gate, QuantileRule
from tasks.results.statistics.episodes_needed import (
    episodes_needed,
    episodes_needed_at_any_look,
    episodes_needed_for_quantile,
    pairs_needed,
)

_INDENT = " " * 18
_RATES = (1.0, 0.98, 0.95)
_BAD_RATES = (0.0, 0.02, 0.05)
_DISAGREEING = (0.0, 0.02, 0.1)


def gate_lines(gate: Gate, judged: Judged, audited: int, programs: int = 1) -> Iterator[str]:
    """Yields lines for a person: each rule, and what it needs if episodes come out in some ways.

    Args:
        gate: The document's section.
        judged: What it is going to judge by.
        audited: How many of the batch's episodes are driven again on C MuJoCo.
        programs: How many compiled programs the batch has; only of one its episodes can be shuffled, to end it early.
    """
    if gate.stopEarly and programs > 1:
        gate = gate.model_copy(update={"stopEarly": False})
        ends = [f"runs the batch to its end: its {programs} programs cannot be shuffled into common chunks"]
    else:
        ends = ["may end the batch early, after any chunk"] * bool(gate.stopEarly)
    episodes = judged.episodes
    lines = [*_rate_lines(gate, episodes), *_collision_lines(gate, episodes), *_comparison_lines(gate, judged)]
    lines += _flip_lines(gate, audited)
    for rule in gate.quantiles or ():
        lines += _quantile_lines(rule, episodes)
    lines += ends
    for number, line in enumerate(lines):
        yield f"{'gate':<18}{line}" if number == 0 else f"{_INDENT}{line}"


def _rate_lines(gate: Gate, episodes: int) -> Iterator[str]:
    rule = gate.successRate
    if rule is None:
        return
    yield f"at least {100 * rule.atLeast:g} % pass, {_sure(rule.confidence)}"
    for rate in _RATES:
        needed = _needed(gate, rule.atLeast, rule.confidence, rate)
        yield from _line(f"if {100 * rate:g} % pass", needed, episodes)


def _collision_lines(gate: Gate, episodes: int) -> Iterator[str]:
    rule = gate.collisionRate
    if rule is None:
        return
    yield f"at most {100 * rule.atMost:g} % collide, {_sure(rule.confidence)}"
    for rate in _BAD_RATES:
        needed = _needed(gate, 1.0 - rule.atMost, rule.confidence, 1.0 - rate)
        yield from _line(f"if {100 * rate:g} % collide", needed, episodes)


def _comparison_lines(gate: Gate, judged: Judged) -> Iterator[str]:
    rule = gate.noWorseThan
    if rule is None:
        return
    points = f"at most {100 * rule.margin:g} points worse than version {rule.applicationVersion}"
    yield f"{points}, {_sure(rule.confidence)}"
    if judged.no_baseline:
        yield f"will be INCONCLUSIVE: {judged.no_baseline}"
        return
    for share in _DISAGREEING:
        needed = pairs_needed(rule.margin, rule.confidence, share)
        yield from _line(f"if equal, and {100 * share:g} % end otherwise", needed, judged.pairs, " driven by both")


def _flip_lines(gate: Gate, audited: int) -> Iterator[str]:
    rule = gate.maxOutcomeFlipRate
    if rule is None:
        return
    yield f"at most {100 * rule.atMost:g} % end otherwise on C MuJoCo, {_sure(rule.confidence)}"
    needed = episodes_needed(1.0 - rule.atMost, rule.confidence, 1.0)
    yield from _line("if none does", needed, audited, " audited")


def _quantile_lines(rule: QuantileRule, episodes: int) -> Iterator[str]:
    at_least = rule.atLeast is not None
    bar = f"at least {rule.atLeast:g}" if rule.atLeast is not None else f"at most {rule.atMost:g}"
    yield f"the {rule.quantile:g} quantile of {rule.column} {bar}, {_sure(rule.confidence)}"
    tail = rule.quantile if at_least else 1.0 - rule.quantile
    for share in (0.0, tail / 2.0):
        needed = episodes_needed_for_quantile(rule.quantile, rule.confidence, share, at_least=at_least)
        yield from _line(f"if {100 * share:g} % are beyond", needed, episodes)


def _needed(gate: Gate, at_least: float, confidence: float, rate: float) -> int | None:
    return (episodes_needed_at_any_look if gate.stopEarly else episodes_needed)(at_least, confidence, rate)


def _line(case: str, needed: int | None, there: int, what: str = "") -> Iterator[str]:
    if needed is not None:
        yield f"{case}, {needed}{what} are needed: {there} are {'enough' if there >= needed else 'NOT ENOUGH'}"


def _sure(confidence: float) -> str:
    return f"{100 * confidence:g} % confidence"
