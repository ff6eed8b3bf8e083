"""Controllers and agents that kill themselves, as `kill -9` does, at a step that a test chooses.

They are forked from a process that has imported everything, so that hundreds of deaths take minutes.
"""

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from typing import cast

from specs.errors import ObjectExists, StoreUnreachable
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.robot import agent, install, launch, reported_state, update
from tasks.deploy.robot.disk import Disk
from tasks.deploy.rollout import deployment_job
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.store_url import open_store
from tests.deploy.puppets import PuppetRobots

ROBOTS, PAUSABLE = 3, 10
TTL_S, _LOOK_S = 1.5, 0.1
_AGENT_STEPS: tuple[tuple[object, str], ...] = (
    (reported_state.Attempt, "at"),
    (reported_state.Reporter, "tell"),
    (Disk, "save"),
    (Disk, "switch"),
    (Disk, "remember"),
    (Disk, "tidy"),
    (update, "ask_condition"),
    (update, "fetch_bundle"),
    (install, "install"),
    (update, "run_script"),
    (launch.RunningApplication, "_launch"),
    (launch.RunningApplication, "wait_until_up"),
)


class Death:
    """Comes at the nth step, before it or after it; never for 0.

    Args:
        nth: Counted from 1.
        after: Whether the step is done first.
    """

    def __init__(self, nth: int, *, after: bool) -> None:
        self._left = nth
        self._after = after

    def of(self, step: Callable[..., object]) -> Callable[..., object]:
        """Returns the step, as one who may die in it does it."""

        def mortal(*arguments: object, **more: object) -> object:
            self._left -= 1
            dies = self._left == 0
            if dies and not self._after:
                os.kill(os.getpid(), signal.SIGKILL)
            try:
                return step(*arguments, **more)
            finally:
                if dies:
                    os.kill(os.getpid(), signal.SIGKILL)

        return mortal


class MortalStore:
    """A store each of whose requests is a step."""

    def __init__(self, store: Store, death: Death) -> None:
        self.url = store.url
        self._store = store
        self._death = death

    def __getattr__(self, name: str) -> Callable[..., object]:
        return self._death.of(getattr(self._store, name))


def process(work: Callable[..., None], *arguments: object, after: bool = False) -> ForkServerProcess:
    """Returns a process that was started and does the work; its environment is this one's."""
    context: ForkServerContext = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    child = context.Process(target=_in_environment, args=(dict(os.environ), work, arguments, after))
    child.start()
    return child


def control(url: str, request: str, digest: str, nth: int, *, after: bool) -> None:
    """Rolls out to robots that answer whenever the controller sleeps, and dies at the nth request."""
    store = open_store(url)
    robots = PuppetRobots(store, ROBOTS)
    asked = CreateDeploymentJobRequest.model_validate_json(request)
    deployment_job.run_deployment_job(
        cast("Store", MortalStore(store, Death(nth, after=after))),
        asked,
        digest=digest,
        token=asked.clientRequestToken,
        progress=lambda *_: None,
        pace=robots.pace,
    )


def pausable(url: str, request: str, digest: str, *, after: bool) -> None:
    """Rolls out to robots of which one more answers at each look, with a claim that is soon given up."""
    setattr(deployment_job, "hold_claim", partial(hold_claim, ttl_s=TTL_S))  # noqa: B010 - a module's name, in this process alone
    robots = PuppetRobots(open_store(url), PAUSABLE)
    robots.silent = set(robots.names)
    answer, silent = robots.pace.sleep, list(reversed(robots.names))

    def sleep(seconds: float) -> None:
        time.sleep(_LOOK_S)
        robots.silent -= set(silent[-1:])
        del silent[-1:]
        answer(seconds)

    robots.pace_sleep = sleep
    asked = CreateDeploymentJobRequest.model_validate_json(request)
    deployment_job.run_deployment_job(
        open_store(url),
        asked,
        digest=digest,
        token=asked.clientRequestToken,
        progress=lambda *_: None,
        pace=robots.pace,
    )


def roll_out(url: str, request: str, digest: str, *, after: bool) -> None:
    """Rolls out to the fleet's members at the usual pace."""
    asked = CreateDeploymentJobRequest.model_validate_json(request)
    token = asked.clientRequestToken
    deployment_job.run_deployment_job(open_store(url), asked, digest=digest, token=token, progress=lambda *_: None)


def write_for_ever(url: str, folder: str, told: Connection, *, after: bool) -> None:
    """Creates objects until it is killed, and tells which ones the store has acknowledged."""
    store = open_store(url)
    for number in count():
        key = f"{folder}/{number}.json"
        try:
            store.create(key, key.encode() * 100)
        except (StoreUnreachable, ObjectExists):
            time.sleep(_LOOK_S)
        else:
            told.send(key)


def serve(url: str, root: str, nth: int, *, after: bool) -> None:
    """Is the agent of the robot ``r1``, and dies at its nth step."""
    log = os.open(Path(root).parent / "agent.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(log, 1)
    os.dup2(log, 2)
    death = Death(nth, after=after)
    for owner, name in _AGENT_STEPS:
        setattr(owner, name, death.of(getattr(owner, name)))
    pace = ["--poll-s=0.02", "--longest-poll-s=0.05", "--grace-s=0.05", f"--user={os.geteuid()}", "--unsigned"]
    sys.exit(agent.main(["--robot=r1", f"--root={root}", f"--store={url}", *pace]))


def _in_environment(
    environment: Mapping[str, str], work: Callable[..., None], arguments: tuple[object, ...], after: object
) -> None:
    os.environ.update(environment)
    work(*arguments, after=after)
