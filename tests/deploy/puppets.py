"""Robots and stores that do as a test says, and a clock that moves only when the controller sleeps."""

import time
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager

from specs.errors import StageFailed, StoreUnreachable
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.fleet.fleet_registry import create_robot, read_desired, read_reported, register_robot
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.rollout.controller import ControllerPace
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.storage.base.keys import reported_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import JobRecord
from tests.deploy.yard import FLEET, Yard


class PuppetRobots:
    """Robots that answer when the controller sleeps, and a clock that moves only then.

    Attributes:
        silent: Robots that never answer.
        failing: Robots that fail.
        crashing: Robots that are in sync at first, and whose application then crashes in a loop.
        died: Raised once instead of sleeping, after so many sleeps, as a controller dies between two looks.
        pace_sleep: What a controller does instead of sleeping, if a test wants something else.
    """

    def __init__(self, store: Store, robots: int, *, step_s: float = 1.0) -> None:
        self.store = store
        self.names = [f"r{number}" for number in range(robots)]
        self.silent: set[str] = set()
        self.failing: set[str] = set()
        self.crashing: set[str] = set()
        self.dies_after: int | None = None
        self.pace_sleep: Callable[[float], None] | None = None
        self._now_s = time.time()
        self._step_s = step_s
        self._runs = dict[str, str]()  # digests, by robots
        for name in self.names:
            create_robot(store, name)
            register_robot(store, FLEET, name)

    @property
    def pace(self) -> ControllerPace:
        return ControllerPace(now_s=lambda: self._now_s, sleep=self.pace_sleep or self._sleep)

    def asked(self) -> list[Desired]:
        latest = [read_desired(self.store, name)[0] for name in self.names]
        return [desired for desired in latest if desired]

    def _sleep(self, _seconds: float) -> None:
        self._now_s += self._step_s
        if self.dies_after is not None:
            self.dies_after -= 1
            if self.dies_after < 0:
                self.dies_after = None
                raise StageFailed("killed", "as by kill -9")
        for desired in self.asked():
            if desired.robot not in self.silent:
                self._answer(desired)

    def _answer(self, desired: Desired) -> None:
        before = read_reported(self.store, desired.robot) if desired.robot in self.crashing else None
        crashed = before is not None and before.deployment == desired.deployment
        failed = desired.robot in self.failing or crashed
        reported = Reported(
            robot=desired.robot,
            deployment=desired.deployment,
            sequence=desired.sequence,
            boot_id="puppet",
            status="Failed" if failed else "InSync",
            step="ExecutingPreLaunch" if failed else "Finished",
            failure_code="PreLaunchFileFailure" if failed else None,
            running_digest=self._runs.get(desired.robot, "") if failed else desired.digest,
            started_at_s=self._now_s,
            finished_at_s=self._now_s,
        )
        self._runs[desired.robot] = reported.running_digest
        self.store.put(reported_key(desired.robot), encode_document(reported))


class FailingStore:
    """A store whose nth request fails, before or after it has had its effect.

    Attributes:
        left: Requests until the failure; negative after it.
    """

    def __init__(self, store: Store, nth: int, *, after: bool) -> None:
        self.url = store.url
        self.left = nth
        self._store = store
        self._after = after

    def __getattr__(self, name: str) -> Callable[..., object]:
        def request(*arguments: object) -> object:
            # A claim whose release fails is waited for (tests of claims); here that would only take time.
            self.left -= not str(arguments[0]).startswith("claims/")
            fails, self.left = self.left == 0, self.left or -1
            if fails and not self._after:
                raise StoreUnreachable(f"{name} was not sent")
            result = getattr(self._store, name)(*arguments)
            if fails:
                raise StoreUnreachable(f"the answer to {name} was lost")
            return result

        return request


class CountingStore:
    """A store that counts.

    Attributes:
        reads: How often each key was read.
    """

    def __init__(self, store: Store) -> None:
        self.url = store.url
        self.reads: Counter[str] = Counter()
        self._store = store

    def __getattr__(self, name: str) -> Callable[..., object]:
        def request(*arguments: object) -> object:
            if name == "get":
                self.reads[str(arguments[0])] += 1
            return getattr(self._store, name)(*arguments)

        return request


def run(
    yard: Yard,
    robots: PuppetRobots,
    request: CreateDeploymentJobRequest,
    digest: str,
    progress: Callable[[int, int], None] = lambda _ended, _all: None,
    *,
    made: Callable[[], AbstractContextManager[Collection[str] | None]] | None = None,
    rules: RollOutRules | None = None,
) -> JobRecord:
    """Returns the ended job of the request; its token is the request's."""
    token = request.clientRequestToken
    return run_deployment_job(
        yard.store, request, digest=digest, token=token, progress=progress, rules=rules, pace=robots.pace, robots=made
    )
