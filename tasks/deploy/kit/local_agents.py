"""Agents for a demonstration: processes of this machine that end with the process that started them."""

import contextlib
import logging
import os
import platform
import subprocess
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path

from specs.field_types import Architecture
from tasks.deploy.fleet.fleets import create_fleet
from tasks.deploy.fleet.robots import create_robot, deregister_robot, members, register_robot
from tasks.deploy.kit.agent_reserve import call_up, robot_arguments
from tasks.deploy.robot.disk import lock_folder
from tasks.deploy.robot.processes import end_all
from tasks.storage.base.store import Store

_LOG = logging.getLogger(__name__)
_PATIENCE_S = 10.0
_ARCHITECTURES: Mapping[str, Architecture] = {
    "aarch64": "ARM64",
    "arm64": "ARM64",
    "armv7l": "ARMHF",
    "armv8l": "ARMHF",
}
# A look at a folder costs a millisecond, and of a roll-out a wave waits for it.
_POLL_S = _LONGEST_POLL_S = "0.05"


@contextmanager
def local_agents(
    store: Store,
    fleet: str,
    count: int,
    folder: Path,
    *,
    grace_s: float = 1.0,
    root_of_trust: Path | None = None,
) -> Generator[tuple[str, ...]]:
    """Yields the names of robots ``<fleet>-1`` to ``<fleet>-<count>`` whose agents run inside the ``with`` block.

    The fleet and the robots are made where they are missing; robots that an earlier demonstration made beyond the count
    leave the fleet, because no agent would answer for them. Agents and applications end with the block, and by
    themselves when this process is killed; agents of a later block on the same folder wait for that. Whoever opens the
    block must have the fleet for itself (`tasks.deploy.rollout.job.run_deployment_job`): it changes who is a member.

    Args:
        store: Where the fleet is.
        fleet: Its name.
        count: How many robots, from 0.
        folder: Holds a folder for each robot, which keeps its versions and its state.
        grace_s: How long an application must stay up for its launch to count.
        root_of_trust: What the agents verify against; None for agents that verify nothing.

    Raises:
        DocumentError: The name is none, or a robot belongs to another fleet.
    """
    names = _robots(store, fleet, count)
    roots = [folder.absolute() / name for name in names]
    agents: list[subprocess.Popen[bytes]] = []
    try:
        for root in roots:
            agents.append(_begin(store, root, grace_s, root_of_trust))  # noqa: PERF401 - one may fail after others
        yield names
    finally:
        _end(agents)
        for root in roots:
            _sweep(root)


def local_names(fleet: str, count: int) -> tuple[str, ...]:
    """Returns what the robots of a demonstration are called."""
    return tuple(f"{fleet}-{number}" for number in range(1, count + 1))


def machine_architecture() -> Architecture:
    """Returns the architecture of this machine, in RoboMaker's words; X86_64 for one that it has no word for."""
    return _ARCHITECTURES.get(platform.machine().lower(), "X86_64")


def _robots(store: Store, fleet: str, count: int) -> tuple[str, ...]:
    create_fleet(store, fleet)
    names = local_names(fleet, count)
    for name in names:
        create_robot(store, name, machine_architecture(), local=True)
        register_robot(store, fleet, name)
    for robot in members(store, fleet):
        if robot.local and robot.name not in names:
            deregister_robot(store, robot.name)
    return names


def _begin(store: Store, root: Path, grace_s: float, trust: Path | None) -> subprocess.Popen[bytes]:
    # What they run was simulated by this process already, under its account.
    account = {"parent": str(os.getpid()), "user": str(os.geteuid())}
    pace = {"poll-s": _POLL_S, "longest-poll-s": _LONGEST_POLL_S, "grace-s": str(grace_s)}
    options = [f"--{option}={value}" for option, value in {**account, **pace}.items()]
    return call_up(
        root, [*robot_arguments(store, root), *options, f"--root-of-trust={trust}" if trust else "--unsigned"]
    )


def _sweep(root: Path) -> None:
    """Ends what an agent that was killed has left, unless another agent works in the folder: then it is that one's."""
    if root.is_dir():
        with lock_folder(root) as locked:
            if locked():
                end_all(root)


def _end(agents: list[subprocess.Popen[bytes]]) -> None:
    for agent in agents:
        agent.terminate()
    for agent in agents:
        with contextlib.suppress(subprocess.TimeoutExpired):
            agent.wait(_PATIENCE_S)
        if agent.poll() is None:
            _LOG.warning("agent %d does not end by itself", agent.pid)
            agent.kill()
            agent.wait()
