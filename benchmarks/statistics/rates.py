"""How often the interval of a rate over worlds covers, says PASS wrongly, and says PASS: simulated, no simulator.

python -m benchmarks.statistics.rates
"""

import numpy as np

from benchmarks.statistics.simulated_worlds import (
    CONFIDENCE,
    DESIGNS,
    ICCS,
    RATES,
    REPLICATES,
    Chances,
    beta,
    logit_normal,
    logit_normal_rate,
    mixture,
    shares_of,
)
from benchmarks.statistics.table_file import Rows, keep, per_cent
from tasks.results.statistics.intervals import wilson_bounds
from tasks.results.statistics.over_worlds import rates_shown

BAR, POWER_RATES = 0.9, (0.95, 0.98, 0.99)
_SEED = 18
# Of the episodes of each world, what is left after others were canceled.
_LEFT = (1.0, 0.25, 0.75, 0.5)
_OTHERS: dict[str, tuple[float, Chances]] = {
    "10 % of worlds at .3, others at .99": (0.921, mixture(0.99, 0.3, 0.1)),
    "30 % of worlds at .7, others at .99": (0.903, mixture(0.99, 0.7, 0.3)),
    "log odds normal about .95, sd 1": (logit_normal_rate(0.95, 1.0), logit_normal(0.95, 1.0)),
    "log odds normal about .98, sd 2": (logit_normal_rate(0.98, 2.0), logit_normal(0.98, 2.0)),
    "beta, rate .95, ICC .5": (0.95, beta(0.95, 0.5)),
    "beta, rate .9, ICC .75": (0.9, beta(0.9, 0.75)),
}


def shown(worlds: int, n: int, chances: Chances, rate: float, replicates: int = REPLICATES) -> tuple[float, float]:
    """Returns how often batches show that the rate is above a number, and how often that it is below."""
    return _shown(np.full(worlds, n), chances, rate, replicates)


def coverage() -> Rows:
    """Returns per design and rate, for each correlation: coverage and false PASS with the bar at the rate."""
    rows = [["worlds x episodes", "rate", *(f"ICC {icc:g}" for icc in ICCS)]]
    for worlds, n in DESIGNS:
        for rate in RATES:
            found = [shown(worlds, n, beta(rate, icc), rate) for icc in ICCS]
            cells = [per_cent(1.0 - above - below, above) for above, below in found]
            rows.append([f"{worlds} x {n}", f"{rate:g}", *cells])
    return rows


def power() -> Rows:
    """Returns per true rate and design, for each correlation: how often the gate says PASS at the bar."""
    rows = [["true rate", "worlds x episodes", *(f"ICC {icc:g}" for icc in ICCS)]]
    for rate in POWER_RATES:
        for worlds, n in (*DESIGNS[:3], (384, 1)):
            cells = [per_cent(shown(worlds, n, beta(rate, icc), BAR)[0]) for icc in ICCS]
            rows.append([f"{rate:g}", f"{worlds} x {n}", *cells])
    return rows


def other_worlds() -> Rows:
    """Returns coverage and false PASS where chances are not beta distributed, and where episodes were canceled."""
    rows = [["worlds", *(f"{worlds} x {n}" for worlds, n in DESIGNS[:3])]]
    for name, (rate, chances) in _OTHERS.items():
        found = [shown(worlds, n, chances, rate) for worlds, n in DESIGNS[:3]]
        rows.append([name, *(per_cent(1.0 - above - below, above) for above, below in found)])
    for rate, icc in ((0.9, 0.1), (0.95, 0.3)):
        found = [_shown(_some(worlds, n), beta(rate, icc), rate, REPLICATES) for worlds, n in DESIGNS[:3]]
        cells = [per_cent(1.0 - above - below, above) for above, below in found]
        rows.append([f"beta, rate {rate:g}, ICC {icc:g}, 3 of 8 canceled", *cells])
    return rows


def these_worlds() -> Rows:
    """Returns how often Wilson's interval covers the rate in the worlds that were drawn, and in worlds like them."""
    rows = [["worlds x episodes", "rate", *(f"ICC {icc:g}" for icc in ICCS)]]
    for worlds, n in DESIGNS[:3]:
        for rate in RATES[:2]:
            cells = [per_cent(*wilsons(worlds, n, rate, icc)) for icc in ICCS]
            rows.append([f"{worlds} x {n}", f"{rate:g}", *cells])
    return rows


def wilsons(worlds: int, n: int, rate: float, icc: float) -> tuple[float, float]:
    """Returns how often Wilson's interval covers the mean chance of the worlds drawn, and of all worlds."""
    random = np.random.default_rng(_SEED)
    chances = beta(rate, icc)(random, (REPLICATES, worlds))
    passed = random.binomial(n, chances).sum(axis=1).astype(np.float64)
    lower, upper = wilson_bounds(passed, np.full(REPLICATES, float(worlds * n)), CONFIDENCE)
    here = chances.mean(axis=1)
    return float(((lower <= here) & (here <= upper)).mean()), float(((lower <= rate) & (rate <= upper)).mean())


def main() -> None:
    """Prints and keeps all tables of rates."""
    for name, table in (
        ("rates", coverage),
        ("power", power),
        ("other worlds", other_worlds),
        ("these worlds", these_worlds),
    ):
        keep(name, table())


def _some(worlds: int, n: int) -> np.ndarray:
    return np.maximum(1, np.round(n * np.resize(_LEFT, worlds))).astype(np.int64)


def _shown(n: np.ndarray, chances: Chances, rate: float, replicates: int) -> tuple[float, float]:
    random = np.random.default_rng(_SEED)
    counts = random.binomial(n, chances(random, (replicates, len(n))))
    return shares_of(lambda some: rates_shown(some, n, rate, CONFIDENCE), counts, alike=bool((n == n[0]).all()))


if __name__ == "__main__":
    main()
