"""A roll-out to real agents, as processes of this machine: a version that stays up, then one that does not."""

import time
from collections import Counter
from functools import partial
from pathlib import Path

from specs.arn import arn
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.rollout.job import run_deployment_job
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import store_id

FLEET = "agents"
AGENTS_HEAD = ["store", "agents", "good version", "s", "broken version", "s", "still run the good one"]
_GOOD = "#!/bin/sh\nexec sleep 1000\n"
_BROKEN = "#!/bin/sh\nexit 1\n"


def agents_row(store: Store, count: int, folder: Path) -> list[str]:
    """Returns a row of the table; what the agents started ends with them."""
    create_fleet(store, FLEET)
    good_s, good, digest = _deployed(store, count, folder, _GOOD, "good")
    broken_s, broken, _ = _deployed(store, count, folder, _BROKEN, "broken")
    links = (folder / FLEET / store.url.partition(":")[0]).glob("*/current")
    return [
        store.url.partition(":")[0],
        str(count),
        _told(good),
        f"{good_s:.0f}",
        _told(broken),
        f"{broken_s:.0f}",
        f"{sum(link.readlink().name == digest for link in links)} of {count}",
    ]


def _deployed(store: Store, count: int, folder: Path, program: str, token: str) -> tuple[float, JobRecord, str]:
    package = folder / f"{FLEET}-{token}" / "app"
    package.mkdir(parents=True, exist_ok=True)
    (package / "run.sh").write_text(program)
    (package / "run.sh").chmod(0o755)
    version = publish_bundle(store, "robot-application", "app", package.parent)
    begun_s = time.perf_counter()
    record = run_deployment_job(
        store,
        _request(store, version.number, token),
        digest=version.digest,
        token=token,
        progress=lambda *_: None,
        robots=partial(local_agents, store, FLEET, count, folder / FLEET / store.url.partition(":")[0]),
    )
    return time.perf_counter() - begun_s, record, version.digest


def _told(record: JobRecord) -> str:
    counts = Counter(robot.failure_code or robot.status for robot in recorded_progress(record).values())
    return f"{record.status}: " + ", ".join(f"{count} {what}" for what, count in sorted(counts.items()))


def _request(store: Store, version: int, token: str) -> CreateDeploymentJobRequest:
    identifier = store_id(store)
    return CreateDeploymentJobRequest.model_validate(
        {
            "clientRequestToken": token,
            "fleet": arn("deployment-fleet", identifier, FLEET),
            "deploymentConfig": {"concurrentDeploymentPercentage": 20, "failureThresholdPercentage": 20},
            "deploymentApplicationConfigs": [
                {
                    "application": arn("robot-application", identifier, "app"),
                    "applicationVersion": str(version),
                    "launchConfig": {"packageName": "app", "launchFile": "run.sh"},
                }
            ],
        }
    )
