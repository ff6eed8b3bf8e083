"""The processes of a demonstration's agents; some are begun in reserve, before there is anything for them to do.

An agent takes half a second of the processor to import what it needs. In reserve it does that, and nothing else, while
the run does something else, such as auditing the batch. It ends when its input ends: with the block, or with the
process that began it, however that ends.
"""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock

from tasks.deploy.robot.agent import RESERVE
from tasks.storage.base.store import Store

_NOT_FOR_AGENTS = ("SIMYARD_KEYS", "SIMYARD_OWNER_KEY", "PREFECT_")
_PACKAGES = Path(__file__).parents[3]
_waiting: dict[Path, subprocess.Popen[bytes]] = {}  # by the folders of their robots
_turn = Lock()


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
