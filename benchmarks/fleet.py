"""A roll-out to many simulated robots through the real controller: time, store requests, limits kept.

    .venv/bin/python -m benchmarks.fleet [--robots 100 1000] [--s3] [--document docs/fleet.md]

Robots are objects in the store that answer when the controller sleeps, by a fault model: most take some looks to
install, some are offline, some are slow, some fail a script or a download. The clock moves only when the controller
sleeps, so the time shown is what the controller and the store take, not what robots would.
"""

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import cast

from benchmarks.machine import machine
from benchmarks.tables import markdown, with_tables
from specs.arn import arn
from specs.deployment import CreateDeploymentJobRequest
from tasks.applications.publishing import publish
from tasks.deploy.controller import Pace
from tasks.deploy.fleets import create_fleet
from tasks.deploy.job import run_deployment_job
from tasks.deploy.observing import recorded_progress
from tasks.deploy.robots import create_robot, register_robot
from tasks.deploy.states import Desired, Reported
from tasks.storage.encoding import encoded
from tasks.storage.keys import reported_key
from tasks.storage.opening import open_store, store_id
from tasks.storage.store import Store

FLEET, CONCURRENT_PERCENT, THRESHOLD_PERCENT, TIMEOUT_S, LOOK_S = "benchmark", 10, 20, 600, 5.0
FAULTS = {"offline": 0.02, "slow": 0.10, "failing script": 0.01, "corrupt download": 0.01}


@dataclass
class CountedStore:
    """A store that counts its requests while ``counting`` is set."""

    store: Store
    requests: Counter[str] = field(default_factory=Counter[str])
    counting: bool = False

    @property
    def url(self) -> str:
        """Returns the store's URL."""
        return self.store.url

    def __getattr__(self, name: str) -> Callable[..., object]:
        """Returns the store's method, counted."""
        method = getattr(self.store, name)

        def request(*arguments: object) -> object:
            self.requests[name] += self.counting
            return method(*arguments)

        return request


class Robots:
    """Simulated robots: they see what they are asked the moment it is written, and answer in their own time."""

    def __init__(self, store: Store, count: int, dice: Random) -> None:
        """Makes and registers them; each draws its fault, if any."""
        self._store, self._dice, self._now_s = store, dice, time.time()
        self._fault = {f"r{number:04d}": self._drawn() for number in range(count)}
        self._left: dict[str, int] = {}
        self._asked: dict[str, Desired] = {}
        self.most_at_once = 0
        for name in self._fault:
            create_robot(store, name)
            register_robot(store, FLEET, name)

    def _drawn(self) -> str:
        draw = self._dice.random()
        for fault, share in FAULTS.items():
            if draw < share:
                return fault
            draw -= share
        return ""

    def hear(self, desired: Desired) -> None:
        """Begins what a robot is asked for."""
        self._asked[desired.robot] = desired
        slow = self._fault[desired.robot] == "slow"
        self._left[desired.robot] = self._dice.randint(30, 90) if slow else self._dice.randint(1, 6)
        self.most_at_once = max(self.most_at_once, len(self._left))

    def pass_time(self, _seconds: float) -> None:
        """Lets one look's time pass."""
        self._now_s += LOOK_S
        for name in list(self._left):
            self._left[name] -= 1
            if self._fault[name] == "offline":
                if self._now_s - self._asked[name].issued_at_s > TIMEOUT_S:
                    del self._left[name]
            elif self._left[name] == 0:
                del self._left[name]
                self._answer(self._asked[name])

    def _answer(self, desired: Desired) -> None:
        code = {"failing script": "PreLaunchFileFailure", "corrupt download": "EtagMismatch"}.get(
            self._fault[desired.robot]
        )
        told = {
            "robot": desired.robot,
            "deployment": desired.deployment,
            "sequence": desired.sequence,
            "boot_id": "simulated",
            "status": "Failed" if code else "InSync",
            "step": "ExecutingPreLaunch" if code else "Finished",
            "failure_code": code,
            "started_at_s": self._now_s,
            "finished_at_s": self._now_s,
        }
        self._store.put(reported_key(desired.robot), encoded(Reported.model_validate(told)))

    @property
    def pace(self) -> Pace:
        """Returns their clock."""
        return Pace(poll_s=LOOK_S, now_s=lambda: self._now_s, sleep=self.pass_time)


class HeardStore(CountedStore):
    """A counted store whose desired states are heard by the robots, as if they looked all the time."""

    robots: Robots | None = None

    def create(self, key: str, body: bytes) -> str:
        """Creates, and lets the robot hear."""
        self.requests["create"] += self.counting
        etag = self.store.create(key, body)
        if self.robots and key.startswith("robots/") and key.endswith("/desired.json"):
            self.robots.hear(Desired.model_validate_json(body))
        return etag


def rolled_out(store: Store, count: int, folder: Path) -> list[str]:
    """Returns a row of the table: one roll-out to a fleet of so many."""
    counted = HeardStore(store)
    create_fleet(store, FLEET)
    robots = Robots(store, count, Random(count))  # noqa: S311 - a fault model
    (folder / "bundle/app").mkdir(parents=True, exist_ok=True)
    program = folder / "bundle/app/run.sh"
    program.write_text("#!/bin/sh\nexec sleep 1000\n")
    program.chmod(0o755)
    version = publish(store, "robot-application", "app", folder / "bundle")
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
            from tests.seaweed import running_seaweed  # noqa: PLC0415 - only here

            (folder / "weed").mkdir()
            server = stack.enter_context(running_seaweed(folder / "weed"))
            server.make_bucket("fleet")
            os.environ.update(server.environment())
            urls.append("s3://fleet/store")
        yield urls


def main() -> None:
    """Measures and shows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--s3", action="store_true", help="on SeaweedFS, too")
    parser.add_argument("--document", type=Path, help="a document to put the table into")
    options = parser.parse_args()
    head = ["store", "robots", "ended", "robots ended", "most at once", "wall s", "CPU s", "requests a robot"]
    table = [head]
    with tempfile.TemporaryDirectory(prefix="simyard-fleet-") as name, stores(Path(name), s3=options.s3) as urls:
        places = [(f"{url}-{count}", count) for url in urls for count in options.robots]
        table += [rolled_out(open_store(place), count, Path(name)) for place, count in places]
    text = f"{machine()}\n\n{markdown(table)}"
    sys.stdout.write(f"{text}\n")
    if options.document:
        options.document.write_text(with_tables(options.document.read_text(), "fleet", text))


if __name__ == "__main__":
    main()
