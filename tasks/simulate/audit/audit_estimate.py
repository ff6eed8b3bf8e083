"""What a sample says of its batch: which share comes out otherwise on C MuJoCo, and whether that is chaos.

Lanes are weighted by what they stand for, so that the estimates are those of the batch. A control tells chaos from an
engine's error: C MuJoCo drives the lanes again, a micrometre beside. An engine that is as good as C MuJoCo is just one
more of these drives.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from specs.base import Spec

CONFIDENCE = 0.95
"""Coverage of the intervals of a report; a gate computes its own."""


class Ending(NamedTuple):
    """What came of an episode on an engine: whether it passed, and whether the robot touched anything."""

    passed: bool
    touched: bool


Trait = Callable[[Ending], bool]


class ComparedLane(NamedTuple):
    """An episode on its own engine and on C MuJoCo.

    Attributes:
        episode: Its index.
        weight: For how many of the batch's episodes it stands.
        row: By the engine that made its row.
        reference: By C MuJoCo.
        disturbed: By C MuJoCo a micrometre beside, in each direction; none where there was no control.
    """

    episode: int
    weight: float
    row: Ending
    reference: Ending
    disturbed: tuple[Ending, ...] = ()


class FlipShare(Spec):
    """Of the episodes that show something by their rows: how many do not show it on C MuJoCo.

    Attributes:
        lanes: Those that were compared.
        flips: How many of them do not show it on C MuJoCo.
        chaotic: Of these, lanes that do show it on C MuJoCo a micrometre beside: C MuJoCo flips them by itself.
        episodes: For how many of the batch's episodes the lanes stand.
        effective: To how many equally weighted lanes they come.
        rate: The weighted share of flips, 0-1; None of no lanes.
        beyond: The weighted share of flips that are not chaotic.
        lower, upper: The 95 % interval of the rate.
        chance: How often an engine that is as good as C MuJoCo would flip so many, by the control; None without one.
    """

    lanes: int = 0
    flips: int = 0
    chaotic: int = 0
    episodes: float = 0.0
    effective: float = 0.0
    rate: float | None = None
    beyond: float | None = None
    lower: float = 0.0
    upper: float = 1.0
    chance: float | None = None

    @property
    def unexplained(self) -> int:
        """Returns the flips that are not chaotic."""
        return self.flips - self.chaotic

    def text(self) -> str:
        """Returns such as ``1 of 16``."""
        return f"{self.flips} of {self.lanes}"


class TotalShare(Spec):
    """The share of a batch's episodes whose success is another one on C MuJoCo, with its 95 % interval."""

    rate: float | None = None
    lower: float = 0.0
    upper: float = 1.0


def flip_share(lanes: Sequence[ComparedLane], trait: Trait) -> FlipShare:
    """Returns how many of the lanes with a trait have it not on C MuJoCo.

    Args:
        lanes: All compared lanes, those without the trait too: what chance does is seen in them as well.
        trait: What an ending shows or not.
    """
    own = [lane for lane in lanes if trait(lane.row)]
    if not own:
        return FlipShare()
    flipped = [lane for lane in own if not trait(lane.reference)]
    chaotic = [lane for lane in flipped if any(map(trait, lane.disturbed))]
    all_of = weight_of(own)
    rate, effective = weight_of(flipped) / all_of, all_of**2 / sum(lane.weight**2 for lane in own)
    lower, upper = share_bounds(rate, effective, CONFIDENCE)
    return FlipShare(
        lanes=len(own),
        flips=len(flipped),
        chaotic=len(chaotic),
        episodes=all_of,
        effective=effective,
        rate=rate,
        beyond=rate - weight_of(chaotic) / all_of,
        lower=lower,
        upper=upper,
        chance=chance_of(lanes, trait) if any(lane.disturbed for lane in lanes) else None,
    )


def total_share(strata: Sequence[FlipShare]) -> TotalShare:
    """Returns the share of flips over strata, each weighted by its episodes.

    The interval joins those of the strata by their distances from the estimates (Zou and Donner 2008, Statistics in
    Medicine 27:1693, section 2).
    """
    present = [each for each in strata if each.rate is not None]
    episodes = sum(each.episodes for each in present)
    if not episodes:
        return TotalShare()
    rate, below, above = 0.0, 0.0, 0.0
    for each in present:
        share, estimate = each.episodes / episodes, each.rate or 0.0
        rate += share * estimate
        below += (share * (estimate - each.lower)) ** 2
        above += (share * (each.upper - estimate)) ** 2
    return TotalShare(rate=rate, lower=max(0.0, rate - math.sqrt(below)), upper=min(1.0, rate + math.sqrt(above)))


def share_bounds(rate: float, effective: float, confidence: float) -> tuple[float, float]:
    """Returns the two-sided interval of a share from weighted lanes; ``tasks.results.statistics.strata`` says the same.

    The exact interval of Clopper and Pearson 1934 (Biometrika 26:404), whose bounds are quantiles of beta
    distributions, with the effective number of lanes (Korn and Graubard 1998, Survey Methodology 24:193).

    Args:
        rate: As it was seen, 0-1.
        effective: To how many equally weighted lanes they come, above 0.
        confidence: Coverage, between 0 and 1.
    """
    # The same bits as scipy.stats.beta.ppf, whose import takes a second.
    from scipy.special import betaincinv  # noqa: PLC0415 - whoever reads a report needs no interval

    tail, seen = (1.0 - confidence) / 2.0, rate * effective
    lower = float(betaincinv(seen, effective - seen + 1.0, tail)) if seen > 0.0 else 0.0
    upper = float(betaincinv(seen + 1.0, effective - seen, 1.0 - tail)) if seen < effective else 1.0
    return lower, upper


def own_rate(lanes: Sequence[ComparedLane]) -> float:
    """Returns the weighted chance that two drives of C MuJoCo, a micrometre apart, differ in success.

    Of each lane's drives all pairs count, which is without bias (Hoeffding 1948, Annals of Mathematical Statistics
    19:293).

    Args:
        lanes: With their disturbed drives, at least one lane.
    """
    total = 0.0
    for lane in lanes:
        drives = [lane.reference.passed, *(each.passed for each in lane.disturbed)]
        total += lane.weight * 2 * sum(drives) * drives.count(False) / (len(drives) * (len(drives) - 1))
    return total / weight_of(lanes)


def weight_of(lanes: Sequence[ComparedLane]) -> float:
    """Returns for how many episodes lanes stand."""
    return sum(lane.weight for lane in lanes)


def chance_of(lanes: Sequence[ComparedLane], trait: Trait) -> float:
    """Returns how often so many flips would be seen, were the row's engine just one more disturbed C MuJoCo.

    Then each of a lane's drives might have been the row, so that the null distribution comes from exchanging them
    (Fisher 1935, The Design of Experiments, section 21). Each drive counts by how likely the lane would have been
    drawn, had it been the row: rare failures are drawn more often, and many of them do not happen again. What is added
    up over the lanes whose rows have the trait is how many drives on C MuJoCo have it not.

    Args:
        lanes: With their disturbed drives.
        trait: What an ending shows or not.
    """
    drawn = _drawn_shares(lanes)
    seen, sums = 0, np.ones(1)
    for lane in lanes:
        drives = [lane.row, lane.reference, *lane.disturbed]
        having = [each for each in drives if trait(each)]
        lack = len(drives) - len(having)
        if not having or not lack:
            continue
        seen += lack if trait(lane.row) else 0
        share = sum(drawn[each.passed] for each in having) / sum(drawn[each.passed] for each in drives)
        sums = np.convolve(sums, [1.0 - share, *[0.0] * (lack - 1), share])
    return min(1.0, float(sums[seen:].sum()))


def _drawn_shares(lanes: Sequence[ComparedLane]) -> Mapping[bool, float]:
    """Returns how likely an episode is drawn, by whether it passed; of a kind that there is none of, all are."""
    shares: dict[bool, float] = {}
    for passed in (True, False):
        own = [lane for lane in lanes if lane.row.passed == passed]
        shares[passed] = len(own) / weight_of(own) if own else 1.0
    return shares
