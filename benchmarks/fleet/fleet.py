"""Roll-outs through the real controller: time, store requests, limits kept.

    .venv/bin/python -m benchmarks.fleet.fleet [--robots 100 1000] [--s3] [--agents 20] [--document
    docs/operate/fleet.md]

Simulated robots (benchmarks.fleet.fleet_robots) answer when the controller sleeps: the time shown is what the
controller and the store take, not what robots would. Agents are real processes of this machine; they get a version that
stays up, then one that does not.
"""

import os
import tempfile
import time
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from random import Random
from typing import cast

from benchmarks.fleet.fleet_robots import HeardStore, Robots
from benchmarks.harness import machine, markdown, options, show
from specs.arn import arn
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id

AGENTS_FLEET = "agents"
AGENTS_HEAD = ["store", "agents", "good version", "s", "broken version", "s", "still run the good one"]
_GOOD = "#!/bin/sh\nexec sleep 1000\n"
_BROKEN = "#!/bin/sh\nexit 1\n"


def agents_row(store: Store, count: int, folder: Path) -> list[str]:
    """Returns a row of the table; what the agents started ends with them."""
    create_fleet(store, AGENTS_FLEET)
    good_s, good, digest = _deployed(store, count, folder, _GOOD, "good")
    broken_s, broken, _ = _deployed(store, count, folder, _BROKEN, "broken")
    links = (folder / AGENTS_FLEET / store.url.partition(":")[0]).glob("*/current")
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
    package = folder / f"{AGENTS_FLEET}-{token}" / "app"
    package.mkdir(parents=True, exist_ok=True)
    (package / "run.sh").write_text(program)
    (package / "run.sh").chmod(0o755)
    version = publish_bundle(store, "robot-application", "app", package.parent)
    begun_s = time.perf_counter()
    record = run_deployment_job(
        store,
        _agents_request(store, version.number, token),
        digest=version.digest,
        token=token,
        progress=lambda *_: None,
        robots=partial(local_agents, store, AGENTS_FLEET, count, folder / AGENTS_FLEET / store.url.partition(":")[0]),
    )
    return time.perf_counter() - begun_s, record, version.digest


def _told(record: JobRecord) -> str:
    counts = Counter(robot.failure_code or robot.status for robot in recorded_progress(record).values())
    return f"{record.status}: " + ", ".join(f"{count} {what}" for what, count in sorted(counts.items()))


def _agents_request(store: Store, version: int, token: str) -> CreateDeploymentJobRequest:
    identifier = store_id(store)
    return CreateDeploymentJobRequest.model_validate(
        {
            "clientRequestToken": token,
            "fleet": arn("deployment-fleet", identifier, AGENTS_FLEET),
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


FLEET, CONCURRENT_PERCENT, THRESHOLD_PERCENT, TIMEOUT_S = "benchmark", 10, 20, 600
HEAD = ["store", "robots", "ended", "robots ended", "most at once", "wall s", "CPU s", "requests a robot"]


def rolled_out(store: Store, count: int, folder: Path) -> list[str]:
    """Returns a row of the table: one roll-out to a fleet of so many."""
    counted = HeardStore(store)
    create_fleet(store, FLEET)
    robots = Robots(store, FLEET, count, dice=Random(count), timeout_s=TIMEOUT_S)  # noqa: S311 - a fault model
    (folder / "bundle/app").mkdir(parents=True, exist_ok=True)
    program = folder / "bundle/app/run.sh"
    program.write_text("#!/bin/sh\nexec sleep 1000\n")
    program.chmod(0o755)
    version = publish_bundle(store, "robot-application", "app", folder / "bundle")
    counted.robots, counted.counting = robots, True
    start_s, cpu_s = time.perf_counter(), time.process_time()
    record = run_deployment_job(
        cast("Store", counted),
        _request(store, version.number),
        digest=version.digest,
        token="benchmark",  # noqa: S106 - of a client request
        progress=lambda *_: None,
        pace=robots.pace,
    )
    took_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
    statuses = Counter(robot.status for robot in recorded_progress(record).values())
    allowed = max(1, count * CONCURRENT_PERCENT // 100)
    if robots.most_at_once > allowed:
        raise RuntimeError(f"{robots.most_at_once} robots at once, {allowed} allowed")
    if robots.failed_when_asked >= -(-count * THRESHOLD_PERCENT // 100):
        raise RuntimeError(f"a robot was asked when {robots.failed_when_asked} had failed")
    return [
        store.url.partition(":")[0],
        str(count),
        record.status,
        " ".join(f"{number} {status}" for status, number in sorted(statuses.items())),
        f"{robots.most_at_once} of {allowed}",
        f"{took_s:.1f}",
        f"{cpu_s:.1f}",
        f"{sum(counted.requests.values()) / count:.1f}",
    ]


def _request(store: Store, version: int) -> CreateDeploymentJobRequest:
    identifier = store_id(store)
    return CreateDeploymentJobRequest.model_validate(
        {
            "clientRequestToken": "benchmark",
            "fleet": arn("deployment-fleet", identifier, FLEET),
            "deploymentConfig": {
                "concurrentDeploymentPercentage": CONCURRENT_PERCENT,
                "failureThresholdPercentage": THRESHOLD_PERCENT,
                "robotDeploymentTimeoutInSeconds": TIMEOUT_S,
            },
            "deploymentApplicationConfigs": [
                {
                    "application": arn("robot-application", identifier, "app"),
                    "applicationVersion": str(version),
                    "launchConfig": {"packageName": "app", "launchFile": "run.sh"},
                }
            ],
        }
    )


@contextmanager
def stores(folder: Path, *, s3: bool) -> Generator[list[str]]:
    """Yields URLs of places for stores: a folder, and a bucket of SeaweedFS if asked for."""
    with ExitStack() as stack:
        urls = [(folder / "store").as_uri()]
        if s3:
            from tests.servers.seaweed import running_seaweed  # noqa: PLC0415 - only here

            (folder / "weed").mkdir()
            server = stack.enter_context(running_seaweed(folder / "weed"))
            server.make_bucket("fleet")
            os.environ.update(server.environment())
            urls.append("s3://fleet/store")
        yield urls


def main() -> None:
    """Measures and shows."""
    parser = options(__doc__)
    parser.add_argument("--robots", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--s3", action="store_true", help="on SeaweedFS, too")
    parser.add_argument("--agents", type=int, default=0, help="so many real agents, too")
    given = parser.parse_args()
    table = [HEAD]
    with tempfile.TemporaryDirectory(prefix="simyard-fleet-") as name, stores(Path(name), s3=given.s3) as urls:
        places = [(f"{url}-{count}", count) for url in urls for count in given.robots]
        table += [rolled_out(open_store(place), count, Path(name)) for place, count in places]
        text = f"{machine()}\n\n{markdown(table)}"
        if given.agents:
            rows = [agents_row(open_store(f"{url}-agents"), given.agents, Path(name)) for url in urls]
            text += f"\n\n{markdown([AGENTS_HEAD, *rows])}"
    show("fleet", text, given.document)


if __name__ == "__main__":
    main()
