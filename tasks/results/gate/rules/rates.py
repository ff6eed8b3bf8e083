"""The rate of a rule that counts episodes: its interval, whatever is missing, and what it says of which worlds.

A rate of episodes that all drove in the same worlds is about these worlds with other seeds. Worlds like these are
another question: there the episodes of one world count together (``over: worlds``). Each answer says which one it is.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from pydantic import JsonValue

from specs.pipeline.gate_section import CollisionRate, Over, SuccessRate
from tasks.results.gate.missing import Gap, Rule, unseen
from tasks.results.gate.rules.rule import Completeness, GateMaterial, Share, WorldShare
from tasks.results.gate.rules.sentences import percent_text, share_interval
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.worlds.rate_over_worlds import rate_over_worlds
from tasks.results.statistics.worlds.refusal import why_refused
from tasks.results.statistics.worlds.world_spread import world_spread

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
        found = over_worlds([each.whole for each in worlds], confidence)
        return Rate(found, OVER_WORLDS, gone.blocks, where_text(driven, over), "", facts)
    # At a look, the interval itself takes what is not counted there for either.
    best = 0 if lacks.sequential and lacks.looks else gone.best
    more, fewer = (best, 0) if more_is_better else (0, best)
    lower, method = share_interval(share.shown, share.n + fewer, confidence, lacks)
    upper, _ = share_interval(share.shown + share.unknown + more, share.n + more, confidence, lacks)
    interval = Interval(lower=lower.lower, upper=upper.upper)
    unlike = effect >= _UNLIKE and not refusal("rate", lacks, driven)
    note = _note(over_worlds([each.whole for each in worlds], confidence)) if unlike else ""
    return Rate(interval, method, gone.blocks, where_text(driven, over), note, facts)


def over_worlds(shares: Sequence[Share], confidence: float) -> Interval:
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


def refusal(of: Literal["rate", "quantile", "difference"], lacks: Completeness, worlds: int) -> str:
    """Returns why nothing can be said of worlds like these, and what to do; empty if it can."""
    if worlds == 0:
        return "the results do not say in which worlds the episodes were: run the document again"
    if lacks.sequential:
        return (
            "the batch may have been ended by what was counted, and an interval over worlds needs all of it: run the "
            "document again without stopEarly"
        )
    if lacks.missing:
        return f"{lacks.missing} episodes have no row, and nothing says in which worlds: run the document again"
    return why_refused(of, worlds)


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
