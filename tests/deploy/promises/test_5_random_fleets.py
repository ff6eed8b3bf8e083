"""The real controller with random fleets: never more at once than allowed, never further than those in flight."""

from random import Random
from typing import cast

import pytest

from benchmarks.fleet.fleet_robots import FAULTS, HeardStore, Robots
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.deploy.rollout.observation import phases, recorded_progress
from tasks.deploy.rollout.resolved_request import bounds_for
from tasks.deploy.rollout.rollout_plan import Phase
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.store import Store
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.yard import FLEET, STAYS_UP, Yard

pytestmark = pytest.mark.integration
_TIMEOUT_S = 600.0  # longer than the slowest robot takes


@sizes(short=12, long=1000)
def test_no_random_fleet_exceeds_its_limits_and_every_roll_out_ends(yard: Yard, size: int, figures: Figures) -> None:
    dice, robots = Random(size), 0  # noqa: S311 - which fleets
    version = yard.publish({"run.sh": STAYS_UP})
    tried = size if kind(yard.store.url) == "file" else max(2, size // 10)
    for number in range(tried):
        # Writes stay in memory: a thousand fleets on a disk take hours, and benchmarks/fleet/fleet.py has large ones.
        store: Store = OverlayStore(yard.store)
        count = dice.choice([1, 2, 3, 5, 8, 13, 21, 34])
        _one_fleet(store, yard.request(version, f"fleet-{number}"), version.digest, count, dice)
        robots += count
    figures(5, kind(yard.store.url), fleets=tried, robots=robots, limits_passed=0)


def _one_fleet(store: Store, request: CreateDeploymentJobRequest, digest: str, count: int, dice: Random) -> None:
    worse = dice.choice([0.0, 1.0, 5.0, 10.0])
    faults = {name: min(share * worse, 0.9) for name, share in FAULTS.items()}
    heard = HeardStore(store)
    robots = heard.robots = Robots(store, FLEET, count, dice=dice, timeout_s=_TIMEOUT_S, faults=faults)
    percent = {
        "concurrentDeploymentPercentage": dice.randint(1, 100),
        "failureThresholdPercentage": dice.randint(1, 100),
    }
    request = CreateDeploymentJobRequest.model_validate(
        {**request.model_dump(), "deploymentConfig": {**percent, "robotDeploymentTimeoutInSeconds": int(_TIMEOUT_S)}}
    )
    rules = RollOutRules(canaryRobots=dice.choice([0, 0, 1, 3]), leastExecutedRobots=dice.choice([0, 0, 5]))

    record = run_deployment_job(
        cast("Store", heard),
        request,
        digest=digest,
        token=request.clientRequestToken,
        progress=lambda *_: None,
        rules=rules,
        pace=robots.pace,
    )

    ended = list(phases(recorded_progress(record)).values())
    members = len(ended)
    bounds = bounds_for(members, request)
    failed = ended.count(Phase.FAILED)
    canary = Phase.FAILED in ended[: rules.canaryRobots]
    assert robots.most_at_once <= bounds.at_once == max(1, members * percent["concurrentDeploymentPercentage"] // 100)
    assert len(set(robots.asked)) == len(robots.asked) == members - ended.count(Phase.ABORTED)
    assert robots.failed_when_asked < max(bounds.failures, rules.leastExecutedRobots)
    assert len(robots.failed) < max(bounds.failures, rules.leastExecutedRobots) + bounds.at_once
    assert record.status == ("Failed" if canary or failed >= bounds.failures else "Succeeded")
    assert record.status == "Failed" or Phase.ABORTED not in ended
    assert not {Phase.WAITING, Phase.IN_FLIGHT} & set(ended)
