"""What the rules of a gate share: intervals of what they count, the answer, its sentence, and what `simyard plan` says.

A rate of episodes that all drove in the same worlds is about these worlds with other seeds. Worlds like these are
another question: there the episodes of one world count together (``over: worlds``). Each answer says which one it is.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from pydantic import JsonValue

from specs.data.run_report import Verdict
from specs.pipeline.gate_section import CollisionRate, Over, SuccessRate
from tasks.results.gate.missing_data import Gap, Rule, unseen
from tasks.results.gate.rules.rule import Completeness, GateMaterial, PlannedEpisodes, RuleVerdict, Share, WorldShare
from tasks.results.statistics.interim_analyses import inner_interval, repeated_interval
from tasks.results.statistics.intervals import Interval, wilson
from tasks.results.statistics.over_worlds import rate_over_worlds, why_refused, world_spread
from tasks.results.statistics.power import PowerNeeds, effective_episodes, share_needs

AT_LOOKS = "repeated confidence interval"
"""What the interval is called of a batch that was looked at with its end in sight."""


def share_interval(count: int, n: int, confidence: float, lacks: Completeness) -> tuple[Interval, str]:
    """Returns the interval of a share, and what the interval is called.

    Args:
        count: Episodes that show it.
        n: All episodes.
        confidence: Coverage, between 0 and 1.
        lacks: Says whether the batch may have been ended by what was counted.
    """
    if lacks.sequential:
        return _interval_at_look(count, n, confidence, lacks), AT_LOOKS
    return wilson(count, n, confidence), "Wilson"


def _interval_at_look(count: int, n: int, confidence: float, lacks: Completeness) -> Interval:
    """Returns the interval of a share at a look, whatever the episodes would have shown that were not counted there."""
    interval, whole = inner_interval if lacks.inner else repeated_interval, lacks.look(n)
    lower = interval(count, whole, lacks.looks, confidence).lower
    return Interval(lower=lower, upper=interval(count + whole - n, whole, lacks.looks, confidence).upper)


def answer_above(interval: Interval, bar: float, n: int, *, sound: bool) -> Verdict:
    """Returns the answer of a rule whose interval has to be above a bar.

    Args:
        interval: Of what the rule is about.
        bar: The least that passes.
        n: How many were counted; of none nothing is known.
        sound: Whether nothing is missing that might have made it worse.
    """
    if n and interval.upper < bar:
        return "FAIL"
    return "PASS" if n and sound and interval.lower >= bar else "INCONCLUSIVE"


def answer_below(interval: Interval, bar: float, n: int, *, sound: bool) -> Verdict:
    """Returns the answer of a rule whose interval has to be below a bar.

    Args:
        interval: Of what the rule is about.
        bar: The most that passes.
        n: How many were counted; of none nothing is known.
        sound: Whether nothing is missing that might have made it worse.
    """
    if n and interval.lower > bar:
        return "FAIL"
    return "PASS" if n and sound and interval.upper <= bar else "INCONCLUSIVE"


def nothing_counted(rule: str, why: str, facts: Mapping[str, JsonValue] | None = None) -> RuleVerdict:
    """Returns the answer of a rule that has nothing to judge by."""
    return RuleVerdict(rule=rule, verdict="INCONCLUSIVE", sentence=f"INCONCLUSIVE: {why}", facts=dict(facts or {}))


def sentence(answer: Verdict, seen: str, asked: str, lacks: Completeness, note: str = "") -> str:
    """Returns an answer with its reason.

    Args:
        answer: The answer.
        seen: What was seen.
        asked: What the document asks for.
        lacks: What was not there to be counted.
        note: What else is to be known; empty for nothing.
    """
    return "; ".join([f"{answer}: {seen}", asked, *lacks.text(), *[note] * bool(note)])


def rate_text(rate: float, interval: Interval, confidence: float, method: str) -> str:
    """Returns a rate with its interval.

    Args:
        rate: The share that was seen.
        interval: Rounded outwards, so that a bound on the wrong side of the bar is never printed as on it.
        confidence: Its coverage.
        method: What it is called.
    """
    kind = "interval at any look" if method == AT_LOOKS else "interval"
    return f"{100 * rate:.1f} %, {100 * confidence:g} % {kind} {percent_text(interval)}"


def percent_text(interval: Interval) -> str:
    """Returns the bounds of a share in percent, rounded outwards."""
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    return f"{lower:.1f} to {upper:.1f} %"


def confidence_text(confidence: float) -> str:
    """Returns how sure a rule has to be."""
    return f"{100 * confidence:g} % confidence"


def about(over: str | None) -> str:
    """Returns what `simyard plan` adds to a rule that is about worlds like these."""
    return " in worlds like these" if over == "worlds" else ""


OVER_WORLDS = "beta-binomial over worlds"
# From here on an interval of independent episodes is a fifth too short for worlds like these.
_UNLIKE = 1.5
_MOST_CUTS = 16


class Rate(NamedTuple):
    """What is known of a share.

    Attributes:
        interval: Of the share, whatever the unknown episodes would have shown.
        method: What the interval is called.
        blocks: Whether something is missing that lets nothing pass.
        where: In which worlds it holds, to stand in a sentence.
        note: What holds in worlds like these, where these differ and the answer is about these; else empty.
        facts: Number of worlds, correlation in a world, design effect.
    """

    interval: Interval
    method: str
    blocks: bool
    where: str
    note: str
    facts: dict[str, JsonValue]


def rate_of(
    asked: SuccessRate | CollisionRate, rule: Rule, share: Share, material: GateMaterial, label: str
) -> Rate | str:
    """Returns what is known of a share; or why it says nothing.

    Args:
        asked: What the document asks for.
        rule: Whose assumptions hold for what is missing.
        share: How many episodes show it.
        material: What is missing, and what each world shows.
        label: Where the rule stands in the gate.
    """
    confidence, over, more_is_better = asked.confidence, asked.over, isinstance(asked, SuccessRate)
    lacks, worlds = material.lacks, material.world_shares.get(label, ())
    driven = sum(each.ended.n > 0 for each in worlds)
    gone = unseen(rule, gaps(lacks))
    facts, effect = _spread(worlds)
    if over:
        if why := refusal("rate", lacks, driven):
            return why
        found = rate_interval_over_worlds([each.whole for each in worlds], confidence)
        return Rate(found, OVER_WORLDS, gone.blocks, where_text(driven, over), "", facts)
    # At a look, the interval itself takes what is not counted there for either.
    best = 0 if lacks.sequential else gone.best
    more, fewer = (best, 0) if more_is_better else (0, best)
    lower, method = share_interval(share.shown, share.n + fewer, confidence, lacks)
    upper, _ = share_interval(share.shown + share.unknown + more, share.n + more, confidence, lacks)
    interval = Interval(lower=lower.lower, upper=upper.upper)
    unlike = effect >= _UNLIKE and not refusal("rate", lacks, driven)
    note = _note(rate_interval_over_worlds([each.whole for each in worlds], confidence)) if unlike else ""
    return Rate(interval, method, gone.blocks, where_text(driven, over), note, facts)


def rate_interval_over_worlds(shares: Sequence[Share], confidence: float) -> Interval:
    """Returns the interval of a share in worlds like these, whatever the unknown episodes would have shown.

    A world that is worse than it seems moves the rate, and its distance from the others widens the interval. So the
    unknown episodes are tried as showing it in no world, in the highest one, in the two highest, and so on to all;
    highest without them, and highest with them.

    Args:
        shares: Of each world, with one episode at least.
        confidence: Coverage, between 0 and 1.
    """
    n = [share.n for share in shares]
    found = [
        rate_over_worlds(
            [share.shown + share.unknown * high for share, high in zip(shares, cut, strict=True)], n, confidence
        )
        for seen in (
            [share.shown / share.n for share in shares],
            [(share.shown + share.unknown) / share.n for share in shares],
        )
        for cut in cuts([share.unknown for share in shares], seen)
    ]
    return Interval(lower=min(each.lower for each in found), upper=max(each.upper for each in found))


def cuts(unknown: Sequence[int], seen: Sequence[float]) -> Iterator[list[bool]]:
    """Yields which worlds have the high value where it is not known: none, the highest ones, all.

    Args:
        unknown: How many episodes each world has of which it is not known.
        seen: What each world shows besides.
    """
    ranked = sorted((at for at, count in enumerate(unknown) if count), key=lambda at: (-seen[at], at))
    parts = min(len(ranked), _MOST_CUTS)
    for part in range(parts + 1):
        high = set(ranked[: part * len(ranked) // parts] if parts else ())
        yield [at in high for at in range(len(unknown))]


def refusal(of: Literal["rate", "quantile", "difference"], lacks: Completeness, worlds: int, tail: float = 1.0) -> str:
    """Returns why nothing can be said of worlds like these, and what to do; empty if it can.

    Args:
        of: What the interval is of.
        lacks: What the batch lacks.
        worlds: How many worlds have episodes.
        tail: Of a quantile: the share of values beyond it on the side of the bound.
    """
    if worlds == 0:
        return "the results do not say in which worlds the episodes were: run the document again"
    if lacks.sequential:
        return (
            "the batch may have been ended by what was counted, and an interval over worlds needs all of it: run the "
            "document again without stopEarly"
        )
    if lacks.missing:
        return f"{lacks.missing} episodes have no row, and nothing says in which worlds: run the document again"
    return why_refused(of, worlds, tail)


def gaps(lacks: Completeness) -> Mapping[Gap, int]:
    """Returns how many episodes are not among the rows that are counted, by the reason."""
    return {"canceled": lacks.canceled, "no result": lacks.missing, "left out": lacks.left_out}


def where_text(worlds: int, over: Over) -> str:
    """Returns in which worlds something holds, with a space before it; nothing where that is not known."""
    if worlds == 0:
        return ""
    if over:
        return f" in worlds like these {worlds}"
    return f" in these {worlds} worlds" if worlds > 1 else " in this one world"


def _spread(worlds: Sequence[WorldShare]) -> tuple[dict[str, JsonValue], float]:
    """Returns what the evidence says of the worlds, and the design effect; 1 where it is not known."""
    if not worlds:
        return {}, 1.0
    ended = [each.ended for each in worlds]
    spread = world_spread([share.shown for share in ended], [share.n for share in ended])
    facts: dict[str, JsonValue] = {"worlds": spread.worlds}
    if spread.icc is None or spread.design_effect is None:
        return facts, 1.0
    # Six digits, which are the same on any machine.
    known: dict[str, JsonValue] = {"icc": _six(spread.icc), "design_effect": _six(spread.design_effect)}
    return facts | known, spread.design_effect


def _note(interval: Interval) -> str:
    return f"in worlds like these: {percent_text(interval)}"


def _six(value: float) -> float:
    return float(f"{value:.6g}")


ASSUMED_ICC = 0.05
"""Of batches of which no earlier one shows any; real ones have 0 to 0.6 (docs/reference/statistics.md)."""

_NO_ICC = 1e-3


def power_line(case: str, needs: PowerNeeds | None, there: int, what: str = "episodes") -> Iterator[str]:
    """Yields how many are needed in a case, and whether they are there; nothing if no number is enough.

    Args:
        case: The case, such as ``if 98 % pass``.
        needs: What it needs, and the power with those that are there.
        there: How many there are.
        what: What is counted.
    """
    if needs is None:
        return
    give = f"{needs.for_80:,} {what} give 80 % power, {needs.for_90:,} give 90 %"
    if needs.for_80 == needs.for_90:
        give = f"{needs.for_90:,} {what} give 90 % power"
    yield f"{case}, {give}: {there:,} {_enough(needs, there)}"


def share_lines(
    case: str, planned: PlannedEpisodes, at_least: float, confidence: float, rate: float, *, over_worlds: bool
) -> Iterator[str]:
    """Yields what a rule about a share of episodes needs in a case.

    Args:
        case: The case, such as ``if 98 % pass``.
        planned: What there is.
        at_least: The bar, 0-1.
        confidence: Coverage of the interval.
        rate: The share that one expects.
        over_worlds: Whether the rule is about worlds like these.
    """
    if over_worlds:
        yield from _world_lines(case, planned, at_least, confidence, rate)
    elif planned.looks and at_least and rate > at_least:
        from tasks.results.statistics.interim_analyses import chances  # noqa: PLC0415 - arrays, which most commands do without

        found = chances(planned.looks, at_least, confidence, rate)
        drives = f"and drives {found.episodes:.0f} in the mean"
        yield f"{case}, a batch of {planned.looks[-1]:,} passes with {_percent(found.passes)} % power, {drives}"
    else:
        yield from power_line(case, share_needs(at_least, confidence, rate, planned.episodes), planned.episodes)


def worth_line(planned: PlannedEpisodes, what: str = "episodes") -> str:
    """Returns what episodes of few worlds are worth to a rule about worlds like these."""
    worth = effective_episodes(planned.worlds, planned.per_world, _icc(planned))
    laid_out = f"{planned.worlds} worlds x {planned.per_world} {what}"
    return (
        f"about worlds like these; {laid_out} are worth {worth:.0f} independent ones at an ICC of {_icc_text(planned)}"
    )


def _world_lines(case: str, planned: PlannedEpisodes, at_least: float, confidence: float, rate: float) -> Iterator[str]:
    from tasks.results.statistics.power import world_needs  # noqa: PLC0415 - arrays, which most commands do without

    per_world, there = max(1, planned.per_world), planned.worlds
    needs = world_needs(at_least, confidence, rate, icc=_icc(planned), per_world=per_world, there=there)
    alike = "" if rate >= 1.0 else f" at an ICC of {_icc_text(planned)}"
    what = "worlds" if rate >= 1.0 else f"worlds x {per_world}"
    yield from power_line(f"{case}{alike}", needs, there, what)


def _icc(planned: PlannedEpisodes) -> float:
    return ASSUMED_ICC if planned.icc is None else planned.icc


def _icc_text(planned: PlannedEpisodes) -> str:
    """Returns a correlation as people write one; what is left of rounding is none."""
    icc = _icc(planned)
    return "0" if icc < _NO_ICC else f"{icc:.2g}"


def _enough(needs: PowerNeeds, there: int) -> str:
    verb = "is" if there == 1 else "are"
    if there >= needs.for_90:
        return f"{verb} ENOUGH ({_percent(needs.power)} %)"
    if there >= needs.for_80:
        return f"{verb} enough for {_percent(needs.power)} %"
    return f"{verb} NOT ENOUGH ({_percent(needs.power)} %)"


def _percent(power: float) -> str:
    """Returns a probability in percent, rounded down."""
    return f"{math.floor(100.0 * power + 1e-6):d}"
