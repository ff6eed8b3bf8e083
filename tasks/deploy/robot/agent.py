"""The agent, the process on a robot: looks up its desired state in the store, and deploys it.

``python -m tasks.deploy.robot.agent --robot NAME --root DIR --store URL``. Needs Python, pydantic, fsspec and tuf,
nothing else of what Simyard needs. Ends at SIGTERM with exit code 0, and takes its application along.
"""

import argparse
import json
import logging
import os
import random
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from specs.errors import StoreError
from tasks.deploy.fleet.fleet_registry import read_desired
from tasks.deploy.fleet.states import Desired
from tasks.deploy.robot.account import REMEDY, chosen_account, hide_memory, make_home, missing_rights
from tasks.deploy.robot.disk import Disk, lock_folder
from tasks.deploy.robot.launch import LaunchPlace
from tasks.deploy.robot.processes import Stop, StopRequested, adopt_orphans, reap_orphans
from tasks.deploy.robot.reported_state import Outage, Reporter
from tasks.deploy.robot.update import Check, RobotUpdater
from tasks.progress.log_lines import chosen_log_format, log_in_chosen_format
from tasks.storage.base.keys import checked_name, robot_record_key
from tasks.storage.base.store import Store
from tasks.storage.store_url import connect

_LOG = logging.getLogger(__name__)
_GROWTH = 1.3
_LOCK_POLL_S = 0.1
RESERVE = "--reserve"
"""First of the arguments of an agent that only imports until its input says with which arguments it begins."""


class Poll:
    """How long an agent waits between two looks: longer while nothing happens, never in step with other robots.

    Args:
        shortest_s: After something happened.
        longest_s: After nothing happened for a while.
        dice: Where the jitter comes from.
    """

    def __init__(self, shortest_s: float, longest_s: float, dice: random.Random) -> None:
        self._shortest_s = shortest_s
        self._longest_s = longest_s
        self._dice = dice
        self._pause_s = shortest_s

    def next_s(self, *, busy: bool) -> float:
        """Returns how long to wait now."""
        self._pause_s = self._shortest_s if busy else min(self._pause_s * _GROWTH, self._longest_s)
        return self._pause_s * self._dice.uniform(0.75, 1.25)


def serve(robot: RobotUpdater, store: Store, name: str, stop: Stop, poll: Poll) -> None:
    """Runs a robot until it is stopped.

    Args:
        robot: Deploys what is asked.
        store: Where the desired state is.
        name: The robot's name.
        stop: Says when to stop.
        poll: How long to wait between two looks.

    Raises:
        StopRequested: Always; there is no other end.
    """
    seen = ""
    away = Outage("learn what is desired")
    robot.recover()
    while True:
        desired, etag = _look(store, name, away)
        if desired and etag != seen:
            etag = _accept(robot, desired, etag, away)
        robot.supervise()
        pause_s = poll.next_s(busy=etag not in {"", seen})
        seen = etag or seen
        stop.sleep(pause_s)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the agent, and returns 0 when it was stopped.

    Args:
        arguments: The command line, by default this process's.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == [RESERVE]:
        given = _called_up(given)
        if not given:
            return 0
    options = _parser().parse_args(given)
    with log_in_chosen_format():
        return _run(options)


def _called_up(given: Sequence[str]) -> list[str]:
    """Returns the arguments to begin with; none when whoever started this process has ended, or needs no agent.

    Until then it imports what it is going to need, and nothing else: it reads no file, and asks no store.
    """
    if "--unsigned" not in given:
        import_module("tasks.deploy.trust.verification")
    line = sys.stdin.buffer.readline()
    return [str(each) for each in json.loads(line)] if line else []


def _run(options: argparse.Namespace) -> int:
    if chosen_log_format() is None:
        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s", stream=sys.stderr)
    hide_memory()
    stop = Stop(options.parent, reap_orphans)  # or what forks for ever uses up the machine's processes
    stop.listen()
    adopt_orphans()
    disk = Disk(options.root.absolute())
    try:
        with _lock_folder_alone(disk, stop):
            store = connect(options.store)
            for lack in missing_rights(store, options.robot):
                _LOG.error("%s; %s", lack, REMEDY)
            place = _place(options, disk, stop)
            _warn_if_unknown(store, options.robot)
            robot = RobotUpdater(store, place, Reporter(store, options.robot), _check(options, store, disk))
            try:
                serve(robot, store, options.robot, stop, Poll(options.poll_s, options.longest_poll_s, random.Random()))  # noqa: S311 - jitter
            finally:
                robot.end()
    except StopRequested:
        _LOG.info("%s ends", options.robot)
    return 0


def _warn_if_unknown(store: Store, robot: str) -> None:
    """Logs that the store has no such robot: it may be registered later, or this is the wrong store."""
    try:
        known = store.exists(robot_record_key(robot))
    except Exception:  # noqa: BLE001 - the store is away, or somebody answers in its place: what is desired will tell
        return
    if not known:
        _LOG.warning(
            "no robot %s in the store %s: register it (simyard fleet register FLEET %s), or correct --store; waiting",
            robot,
            store.url,
            robot,
        )


def _place(options: argparse.Namespace, disk: Disk, stop: Stop) -> LaunchPlace:
    account = chosen_account(options.user)
    home = make_home(account, disk.root) if account else None
    if account is None and os.geteuid() == 0:
        _LOG.warning("programs run as root, as this agent does: they can read its credentials; --user NAME")
    return LaunchPlace(options.robot, disk, stop, grace_s=options.grace_s, account=account, home=home)


def _accept(robot: RobotUpdater, desired: Desired, etag: str, away: Outage) -> str:
    """Returns the etag of what was accepted or refused for good; an empty text for what is looked at again."""
    try:
        return etag if robot.accept(desired) else ""
    except StoreError as exc:
        away.failed(exc)
        return ""


def _check(options: argparse.Namespace, store: Store, disk: Disk) -> Check | None:
    if options.unsigned:
        _LOG.warning("UNSIGNED: %s runs whatever anybody writes to the store; --root-of-trust FILE", options.robot)
        return None
    from tasks.deploy.trust.verification import Verifier  # noqa: PLC0415 - costs a quarter of a second

    return Verifier(store, disk.root / "trust", options.root_of_trust)


def _look(store: Store, name: str, away: Outage) -> tuple[Desired | None, str]:
    try:
        found = read_desired(store, name)
    except Exception as exc:  # noqa: BLE001 - what is read is anybody's: nothing of it may end what runs
        away.failed(exc)
        return None, ""
    away.worked()
    return found


@contextmanager
def _lock_folder_alone(disk: Disk, stop: Stop) -> Generator[None]:
    """Waits until no other agent works in the folder."""
    with lock_folder(disk.root) as locked:
        while not locked():
            stop.sleep(_LOCK_POLL_S)
        yield


def _bytes(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as exc:
        raise argparse.ArgumentTypeError(f"cannot be read: {exc}") from exc


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="agent", description="Runs on a robot what a fleet's deployments ask for.")
    parser.add_argument("--robot", required=True, type=checked_name, help="the robot's name")
    parser.add_argument("--root", required=True, type=Path, help="the folder for versions, state and logs")
    parser.add_argument("--store", required=True, help="URL of the store")
    trust = parser.add_mutually_exclusive_group(required=True)
    trust.add_argument("--root-of-trust", type=_bytes, metavar="FILE", help="root.json of simyard fleet keys init")
    trust.add_argument("--unsigned", action="store_true", help="verify nothing, and run whatever is in the store")
    parser.add_argument("--poll-s", type=float, default=1.0, help="shortest pause between two looks")
    parser.add_argument("--longest-poll-s", type=float, default=15.0, help="longest pause between two looks")
    parser.add_argument("--grace-s", type=float, default=2.0, help="how long an application must stay up")
    parser.add_argument(
        "--user", help="account of the robot's programs; for an agent of root simyard-app or nobody, else its own"
    )
    parser.add_argument("--parent", type=int, help="end when this process is no longer the agent's parent")
    return parser


if __name__ == "__main__":
    sys.exit(main())
