"""What `simyard plan` prints of a rule's power: how likely it passes, and how many episodes or worlds make it so."""

import math
from collections.abc import Iterator

from tasks.results.gate.rules.rule import PlannedEpisodes
from tasks.results.statistics.power.shares import PowerNeeds, effective_episodes, share_needs

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
        from tasks.results.statistics.looks.stopped_batch import chances  # noqa: PLC0415 - arrays, which most commands do without

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
    from tasks.results.statistics.power.over_worlds import world_needs  # noqa: PLC0415 - arrays, which most commands do without

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
