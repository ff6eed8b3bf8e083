"""Agents for a demonstration: processes of this machine that end with the process that started them.

Some are begun in reserve, before there is anything for them to do.
"""

import contextlib
import json
import logging
import os
import platform
import socket
import subprocess
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock

from specs.field_types import Architecture
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, deregister_robot, members, register_robot
from tasks.deploy.robot.agent import RESERVE
from tasks.deploy.robot.disk import lock_folder
from tasks.deploy.robot.processes import end_all
from tasks.storage.base.store import Store

_NOT_FOR_AGENTS = ("SIMYARD_KEYS", "SIMYARD_OWNER_KEY", "PREFECT_")
_PACKAGES = Path(__file__).parents[3]
_waiting: dict[Path, subprocess.Popen[bytes]] = {}  # by the folders of their robots
_turn = Lock()
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


# An agent takes half a second of the processor to import what it needs. In reserve it does that, and nothing else,
# while the run does something else, such as auditing the batch. It ends when its input ends: with the block, or with
# the process that began it, however that ends.
@contextmanager
def agent_reserve(
    store: Store, names: Sequence[str], folder: Path, *, signed: bool
) -> Generator[Callable[[], None], None, None]:
    """Yields what begins agents that wait to be called up, once; those that nobody has called up end with the block.

    A robot that has one in reserve, which another run of this process began, gets no second one. After the block none
    begins any more.

    Args:
        store: Where their fleet is.
        names: Of their robots.
        folder: Holds a folder for each robot.
        signed: Whether they are going to verify what they run.
    """
    begun, wanted = dict[Path, subprocess.Popen[bytes]](), [folder.absolute() / name for name in names]
    more = [] if signed else ["--unsigned"]

    def begin() -> None:
        with _turn, suppress(OSError):  # a roll-out begins those that are missing, and says what hinders it
            roots, wanted[:] = [root for root in wanted if root not in _waiting], []
            for root in roots:
                begun[root] = _start(root, [RESERVE, *robot_arguments(store, root), *more], subprocess.PIPE)
                _waiting[root] = begun[root]

    try:
        yield begin
    finally:
        with _turn:
            wanted.clear()
            left = [_waiting.pop(root) for root, agent in begun.items() if _waiting.get(root) is agent]
        for agent in left:
            _dismiss(agent)


def call_up(root: Path, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """Returns the agent on a robot's folder, which begins: the one in reserve, else a new process.

    Args:
        root: The folder; its name is the robot's.
        arguments: Of the agent.
    """
    with _turn:
        agent = _waiting.pop(root, None)
    if agent is None:
        return _start(root, arguments, subprocess.DEVNULL)
    if _tell(agent, arguments):
        return agent
    _dismiss(agent)
    return _start(root, arguments, subprocess.DEVNULL)


def robot_arguments(store: Store, root: Path) -> list[str]:
    """Returns the arguments by which a person, or a program, tells one agent from another."""
    return [f"--robot={root.name}", f"--root={root}", f"--store={store.url}"]


def _tell(agent: subprocess.Popen[bytes], arguments: Sequence[str]) -> bool:
    """Returns whether an agent in reserve got its arguments."""
    assert agent.stdin is not None  # noqa: S101 - asked for
    try:
        with agent.stdin as line:
            line.write(json.dumps(arguments).encode() + b"\n")
    except OSError:  # it has ended
        return False
    return agent.poll() is None


def _dismiss(agent: subprocess.Popen[bytes]) -> None:
    """Ends an agent that was not called up: it has done nothing, and has nothing to tidy up."""
    agent.kill()
    with suppress(OSError):
        if agent.stdin:
            agent.stdin.close()
    agent.wait()


def _start(root: Path, arguments: Sequence[str], given: int) -> subprocess.Popen[bytes]:
    root.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join(filter(None, [str(_PACKAGES), os.environ.get("PYTHONPATH")]))
    with (root / "agent.log").open("ab") as log:
        return subprocess.Popen(  # noqa: S603 - this very package, with arguments made here
            [sys.executable, "-m", "tasks.deploy.robot.agent", *arguments],
            env={**_agent_environment(), **_own_ros(root.name), "PYTHONPATH": path},
            stdin=given,
            stdout=log,
            stderr=log,
            start_new_session=True,  # a Ctrl-C in the terminal reaches the parent alone, which then ends its agents
        )


def _agent_environment() -> dict[str, str]:
    """Returns what an agent needs of this process's environment: not the keys, and no way to Prefect's server."""
    return {name: value for name, value in os.environ.items() if not name.startswith(_NOT_FOR_AGENTS)}


def _own_ros(name: str) -> dict[str, str]:
    """Returns where a robot's own ROS is: two robots of one machine must not talk to each other's nodes."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    number = int(name.rpartition("-")[2])
    # Of DDS, domains up to 101 keep clear of other programs' ports (Linux).
    return {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_DOMAIN_ID": str(1 + number % 101),
    }


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
    block must have the fleet for itself (`tasks.deploy.rollout.deployment_job.run_deployment_job`): it changes who is a
    member.

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
