"""Histories of nights without a simulator: what a store's runs would come to."""

from collections.abc import Sequence

import numpy as np

from specs.data.episode import ApplicationLaunch
from tasks.results.statistics.change_point import NightCount
from tasks.results.tables.history_rows import Cell
from tasks.results.trend.trend_series import Night

DAY_S = 86_400.0
BEGIN_S = 1_750_000_000.0
WORLDS = tuple(f"world-{number}-1" for number in range(1, 9))
SPEEDS = ("0.4", "0.6")
PER_CELL = 24


def launch(version: int) -> ApplicationLaunch:
    """Returns a version of courier."""
    digest = f"{version:02x}" * 32
    return ApplicationLaunch(
        name="courier", version=str(version), digest=digest, package="courier", launch_file="go_to_goal"
    )


def night(at: int, rates: Sequence[float], rng: np.random.Generator, *, version: int = 1, **changes: object) -> Night:
    """Returns a night of 384 episodes; each world has a rate."""
    cells = [
        Cell(
            world=f"wgj-{at}/{name}",
            bundle=launch(version).digest,
            variables=(speed,),
            successes=int(rng.binomial(PER_CELL, rate)),
            n=PER_CELL,
        )
        for name, rate in zip(WORLDS, rates, strict=True)
        for speed in SPEEDS
    ]
    base = Night(
        run=f"run-{at}",
        request=f"{version}-{at}",
        worlds_made="template",
        generation=f"wgj-{at}",
        batch=f"simb-{at}",
        arn=f"arn:simyard:simulation-job-batch:0123456789ab:simb-{at}",
        begun_at_s=BEGIN_S + at * DAY_S,
        robots=(launch(version),),
        variables=("MAX_SPEED",),
        cells=tuple(cells),
        authentic=True,
        page=f"file:///store/buckets/results/simb-{at}/report.html",
    )
    return base.model_copy(update=changes)


def history(count: int, drop_at: int = 0, drop: float = 0.06, seed: int = 7) -> list[Night]:
    """Returns nights of a rate of 95 %, from which a new version drops at a night, if any."""
    rng = np.random.default_rng(seed)
    rates = [0.91 + 0.08 * at / (len(WORLDS) - 1) for at in range(len(WORLDS))]
    found: list[Night] = []
    for at in range(count):
        fell = bool(drop_at) and at >= drop_at
        found.append(night(at, [rate - drop for rate in rates] if fell else rates, rng, version=2 + at // 30 + fell))
    return found


def counts(rates: Sequence[float], n: int, seed: int = 7) -> list[NightCount]:
    """Returns nights without worlds."""
    rng = np.random.default_rng(seed)
    return [NightCount(int(rng.binomial(n, rate)), n) for rate in rates]
