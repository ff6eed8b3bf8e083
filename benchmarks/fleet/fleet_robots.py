"""Simulated robots, for measuring and for trying the real controller: objects in a store that answer in their own time.

They answer when the controller sleeps, and the clock moves only then. Each draws a fault, if any: offline, slow, a
script that fails, a download that is corrupt, or an application that crashes in a loop after it was in sync.
"""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random

from tasks.deploy.fleet.fleet_registry import create_robot, register_robot
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.rollout.controller import ControllerPace
from tasks.storage.base.keys import reported_key
from tasks.storage.base.store import Store, encode_document

LOOK_S = 5.0
OFFLINE, SLOW, SCRIPT, DOWNLOAD, CRASH = "offline", "slow", "failing script", "corrupt download", "crash loop later"
FAULTS: Mapping[str, float] = {OFFLINE: 0.02, SLOW: 0.10, SCRIPT: 0.01, DOWNLOAD: 0.01, CRASH: 0.01}
_CODES = {SCRIPT: "PreLaunchFileFailure", DOWNLOAD: "EtagMismatch", CRASH: "EnvironmentSetupError"}


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
    """Simulated robots: they see what they are asked the moment it is written, and answer in their own time.

    Attributes:
        most_at_once: How many of them were ever asked and had not ended.
        failed: Those that told a failure or were silent for too long, without those that crashed after they were in
            sync: of these a controller learns when it looks again.
        failed_when_asked: How many had failed when the last robot was asked.
    """

    def __init__(
        self,
        store: Store,
        fleet: str,
        count: int,
        *,
        dice: Random,
        timeout_s: float,
        faults: Mapping[str, float] = FAULTS,
    ) -> None:
        """Makes and registers them; each draws its fault, if any."""
        self._store, self._dice, self._timeout_s, self._now_s = store, dice, timeout_s, time.time()
        self._fault = {f"r{number:04d}": _drawn(dice, faults) for number in range(count)}
        self._left: dict[str, int] = {}
        self._crash: dict[str, int] = {}
        self._asked: dict[str, Desired] = {}
        self.failed: set[str] = set()
        self.most_at_once = self.failed_when_asked = 0
        for name in self._fault:
            create_robot(store, name)
            register_robot(store, fleet, name)

    @property
    def asked(self) -> tuple[str, ...]:
        """The robots that were asked, in that order."""
        return tuple(self._asked)

    def hear(self, desired: Desired) -> None:
        """Begins what a robot is asked for."""
        self._asked[desired.robot] = desired
        slow = self._fault[desired.robot] == SLOW
        self._left[desired.robot] = self._dice.randint(30, 90) if slow else self._dice.randint(1, 6)
        self.most_at_once = max(self.most_at_once, len(self._left))
        self.failed_when_asked = len(self.failed)

    def pass_time(self, seconds: float) -> None:
        """Lets a look's time pass, or as much as the controller sleeps."""
        self._now_s += max(LOOK_S, seconds)
        for name in list(self._left):
            self._left[name] -= 1
            if self._fault[name] == OFFLINE:
                self._give_up(name)
            elif self._left[name] == 0:
                self._end(name)
        for name in [name for name, left in self._crash.items() if left <= 0]:
            del self._crash[name]
            self._tell(self._asked[name], _CODES[CRASH])
        self._crash = {name: left - 1 for name, left in self._crash.items()}

    def _give_up(self, name: str) -> None:
        if self._now_s - self._asked[name].issued_at_s > self._timeout_s:
            del self._left[name]
            self.failed.add(name)

    def _end(self, name: str) -> None:
        del self._left[name]
        fault = self._fault[name]
        if fault == CRASH:
            self._crash[name] = self._dice.randint(1, 12)
            self._tell(self._asked[name], None)
            return
        code = _CODES.get(fault)
        if code:
            self.failed.add(name)
        self._tell(self._asked[name], code)

    def _tell(self, desired: Desired, code: str | None) -> None:
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
        self._store.put(reported_key(desired.robot), encode_document(Reported.model_validate(told)))

    @property
    def pace(self) -> ControllerPace:
        """Returns their clock."""
        return ControllerPace(poll_s=LOOK_S, now_s=lambda: self._now_s, sleep=self.pass_time)


class HeardStore(CountedStore):
    """A counted store whose desired states are heard by the robots, as if they looked all the time."""

    robots: Robots | None = None

    def create(self, key: str, body: bytes) -> str:
        """Creates, and lets the robot hear."""
        self.requests["create"] += self.counting
        etag = self.store.create(key, body)
        self._heard(key, body)
        return etag

    def replace(self, key: str, body: bytes, etag: str) -> str:
        """Replaces, and lets the robot hear."""
        self.requests["replace"] += self.counting
        after = self.store.replace(key, body, etag)
        self._heard(key, body)
        return after

    def _heard(self, key: str, body: bytes) -> None:
        if self.robots and key.startswith("robots/") and key.endswith("/desired.json"):
            self.robots.hear(Desired.model_validate_json(body))


def _drawn(dice: Random, faults: Mapping[str, float]) -> str:
    draw = dice.random()
    for fault, share in faults.items():
        if draw < share:
            return fault
        draw -= share
    return ""
