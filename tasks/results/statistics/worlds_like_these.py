"""What a batch says of worlds that were not drawn, in numbers and in words."""

from collections.abc import Sequence

from specs.base import Spec
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.rate_text import in_worlds, percent_range
from tasks.results.statistics.worlds.rate_over_worlds import rate_over_worlds
from tasks.results.statistics.worlds.refusal import why_refused
from tasks.results.statistics.worlds.world_spread import WorldSpread, world_spread

# An interval of independent episodes would be a fortieth shorter at most.
_ALIKE = 1.05


class WorldsLikeThese(Spec):
    """What the episodes of some worlds say of worlds that were not drawn.

    Attributes:
        spread: How much the worlds differ.
        confidence: Coverage of the interval, between 0 and 1.
        interval: Of the rate in worlds like these; None where nothing is said of it.
        refused: Why nothing is said; else empty.
    """

    spread: WorldSpread
    confidence: float
    interval: Interval | None = None
    refused: str = ""

    def sentences(self) -> tuple[str, ...]:
        """Returns how much the worlds differ, and what the rate is in worlds like these, as far as that is known."""
        return tuple(filter(None, [self._spread(), self._rate()]))

    def _spread(self) -> str:
        found = self.spread
        if found.icc is None or found.design_effect is None or found.independent_episodes is None:
            return ""
        shown = f"(ICC {found.icc:.2f}, design effect {found.design_effect:.1f})"
        if found.design_effect < _ALIKE:
            return f"No difference between these worlds is seen {shown}."
        worth = max(1, round(found.independent_episodes))
        return (
            f"Worlds differ {shown}: these {found.episodes:,} episodes tell as much about worlds like these as about "
            f"{worth:,} independent one{'s' * (worth > 1)}."
        )

    def _rate(self) -> str:
        where = in_worlds(self.spread.worlds, like_these=True)
        if self.interval is None:
            return f"Nothing is said of the rate {where}: {self.refused}." if self.refused else ""
        return f"The rate {where}: {100 * self.confidence:g}\u00a0% interval {percent_range(self.interval)}."


def worlds_like_these(
    successes: Sequence[int], n: Sequence[int], confidence: float, *, refused: str = ""
) -> WorldsLikeThese:
    """Returns what episodes say of worlds like theirs.

    Args:
        successes: Of each world, 0 to its ``n``.
        n: Episodes of each world; worlds without any do not count.
        confidence: Coverage of the interval, between 0 and 1.
        refused: Why no interval holds, such as that the batch might have ended early; else empty.

    Raises:
        ValueError: The numbers are not such.
    """
    spread = world_spread(successes, n)
    why = refused or (why_refused("rate", spread.worlds) if spread.worlds else "")
    if why or not spread.worlds:
        return WorldsLikeThese(spread=spread, confidence=confidence, refused=why)
    counted = [(passed, count) for passed, count in zip(successes, n, strict=True) if count]
    interval = rate_over_worlds([passed for passed, _ in counted], [count for _, count in counted], confidence)
    return WorldsLikeThese(spread=spread, confidence=confidence, interval=interval)
