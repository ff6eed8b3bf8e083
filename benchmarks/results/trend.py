"""How often a trend alarms while nothing changes, and how soon it sees a drop: simulated histories, no simulator.

    .venv/bin/python -m benchmarks.results.trend [--histories N] [--document docs/guide/trend.md]

Each history has 400 nights. For false alarms nothing changes in them; a drop comes at night 200. Worlds are drawn anew
each night, and their rates are beta distributed with an intra-class correlation; with a correlation of 0 all worlds are
alike. Beside the test that Simyard uses stands one that knows only ranks: a conformal Shiryaev-Roberts test, whose mean
number of nights until a false alarm is guaranteed for nights of any distribution, as long as they are exchangeable
(Vovk 2021, Statistical Science 36:595).
"""

import itertools
import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.harness import ROOT, markdown, options, show
from tasks.results.statistics.change_point import NIGHTS_A_YEAR, NightCount, find_changes

NIGHTS, DROP_AT = 400, 200
DROPS = (0.02, 0.05)
RATES = (0.9, 0.95, 0.99)
CORRELATIONS = (0.0, 0.1)
DESIGNS = ((8, 12), (8, 48), (48, 8))
# All episodes together have half of the false alarms.
LIMIT = 2.0 * NIGHTS_A_YEAR
_BETS = (0.3, 0.5, 0.7)
PAGE = ROOT / "docs/guide/trend.md"
Nights = Sequence[NightCount]
Seen = Callable[[Nights, float], list[int]]


class Setting(NamedTuple):
    """What nights are like: the rate, how alike episodes in one world are, and how many worlds and seeds there are."""

    rate: float
    correlation: float
    worlds: int
    seeds: int


def history(rng: np.random.Generator, setting: Setting, drop: float = 0.0) -> list[NightCount]:
    """Returns nights in worlds that are drawn anew; from `DROP_AT` on the rate is lower by the drop."""
    rates = np.full(NIGHTS, setting.rate)
    rates[DROP_AT:] -= drop
    chance = np.repeat(rates[:, None], setting.worlds, axis=1)
    if setting.correlation:
        size = (1.0 - setting.correlation) / setting.correlation
        chance = rng.beta(chance * size, (1.0 - chance) * size)
    passed, n = rng.binomial(setting.seeds, chance), setting.worlds * setting.seeds
    rate = passed.sum(axis=1) / n
    scatter = ((passed - setting.seeds * rate[:, None]) ** 2 / setting.seeds).sum(axis=1)
    counted = zip(passed.sum(axis=1), scatter, strict=True)
    return [NightCount(int(count), n, float(spread), setting.worlds - 1) for count, spread in counted]


def seen_by_factors(nights: Nights, limit: float) -> list[int]:
    """Returns at which nights Simyard's test alarms."""
    return [change.seen for change in find_changes(nights, limit)]


def seen_by_ranks(nights: Nights, limit: float) -> list[int]:
    """Returns at which nights the test by ranks alarms; it begins anew after each."""
    found: list[int] = []
    begin, capital = 0, np.zeros((2, len(_BETS)))
    for at, night in enumerate(nights):
        rates = np.array([each.successes / each.n for each in nights[begin : at + 1]])
        own = night.successes / night.n
        ranks = np.array([(rates <= own).mean(), (rates >= own).mean()])
        bets = np.array([[bet * rank ** (bet - 1.0) for bet in _BETS] for rank in ranks])
        capital = (1.0 + capital) * bets
        if capital.mean() >= limit:
            found.append(at)
            begin, capital = at + 1, np.zeros((2, len(_BETS)))
    return found


def false_alarms(seen: Seen, setting: Setting, histories: int) -> float:
    """Returns the alarms in 365 nights in which nothing changes."""
    rng = np.random.default_rng(7)
    found = sum(len(seen(history(rng, setting), LIMIT)) for _ in range(histories))
    return found / histories * NIGHTS_A_YEAR / NIGHTS


def nights_until_seen(seen: Seen, setting: Setting, drop: float, histories: int) -> tuple[float, float]:
    """Returns the median and the 90 % quantile of the nights until a drop is seen, the night of the drop being 1."""
    rng = np.random.default_rng(11)
    found: list[float] = []
    for _ in range(histories):
        alarms = seen(history(rng, setting, drop), LIMIT)
        found.append(next((at - DROP_AT + 1.0 for at in alarms if at >= DROP_AT), NIGHTS - DROP_AT + 1.0))
    return float(np.quantile(found, 0.5, method="higher")), float(np.quantile(found, 0.9, method="higher"))


def table(histories: int, seen: Seen = seen_by_factors) -> list[tuple[str, ...]]:
    """Returns a head, and a row for each design, rate and correlation."""
    rows: list[tuple[str, ...]] = [
        ("worlds x episodes", "rate", "correlation", "false alarms a year", "drop of 2 points", "drop of 5 points")
    ]
    for design, rate, correlation in itertools.product(DESIGNS, RATES, CORRELATIONS):
        setting = Setting(rate, correlation, *design)
        until = [_nights(*nights_until_seen(seen, setting, drop, histories)) for drop in DROPS]
        alarms = f"{false_alarms(seen, setting, histories):.2f}"
        print(setting, alarms, until, file=sys.stderr, flush=True)
        rows.append((f"{design[0]} x {design[1]}", f"{100 * rate:g} %", f"{correlation:g}", alarms, *until))
    return rows


def main() -> None:
    """Prints both tables, and writes that of Simyard's test into its page if asked to."""
    parser = options(__doc__)
    parser.add_argument("--histories", type=int, default=20)
    parser.add_argument("--ranks", action="store_true", help="the test by ranks instead")
    given = parser.parse_args()
    rows = table(given.histories, seen_by_ranks if given.ranks else seen_by_factors)
    show("delays", markdown(rows), given.document)


def _nights(median: float, most: float) -> str:
    return ", ".join(f"> {NIGHTS - DROP_AT}" if each > NIGHTS - DROP_AT else f"{each:.0f}" for each in (median, most))


if __name__ == "__main__":
    main()
