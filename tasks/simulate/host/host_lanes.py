"""How many lanes at once a machine holds whose controllers run in processes of their own."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from specs.data.episode import EpisodeRequest
from tasks.ros.ros2.domain import DOMAINS
from tasks.simulate.host.controller_kind import ControllerKind, controller_kind

# A program's lanes are whole vectors of eight: fewer at once save nothing but memory.
FEWEST_LANES = 8
_WITH_PROCESSES: frozenset[ControllerKind] = frozenset({"ros", "ros2"})
# Of an application of three or four nodes; one in Python takes 30 to 40 MB by itself.
_LANE_BYTES = 128 << 20
# More at once are not done sooner, and come to rest later after each stage of a control step.
_LANES_A_CORE = 16
# Each lane of ROS 2 has a DDS domain of its own; whole vectors of them.
_DOMAIN_LANES = len(DOMAINS) // FEWEST_LANES * FEWEST_LANES
# The rest is for what simulates, and for whoever else works here.
_SHARE = 0.6


def most_lanes(requests: Sequence[EpisodeRequest], bundles: Mapping[str, Path]) -> int | None:
    """Returns how many of some episodes this machine simulates at once; None where only arrays count.

    No result depends on it: a lane has the same row whichever lanes run beside it.

    Args:
        requests: The episodes.
        bundles: Unpacked folders of their applications, by digest.
    """
    robots = [request.robot for request in requests if request.robot.digest in bundles]
    launches = {(robot.digest, robot.package, robot.launch_file): robot for robot in robots}
    kinds = {controller_kind(bundles[robot.digest], robot) for robot in launches.values()}
    if not kinds & _WITH_PROCESSES:
        return None
    by_memory, by_cores = int(_SHARE * available_bytes() / _LANE_BYTES), _LANES_A_CORE * len(os.sched_getaffinity(0))
    return max(FEWEST_LANES, min(by_memory, by_cores, _DOMAIN_LANES if "ros2" in kinds else by_cores))


def available_bytes(root: Path = Path("/")) -> int:
    """Returns the memory that is free for new processes, of the machine and of the container that this one runs in.

    Args:
        root: Of the files that tell.
    """
    machine = _fields(root / "proc/meminfo").get("MemAvailable", 0) << 10
    limit, used = (_number(root / "sys/fs/cgroup" / name) for name in ("memory.max", "memory.current"))
    return max(0, machine if limit is None or used is None else min(machine, limit - used))


def _fields(path: Path) -> dict[str, int]:
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return {}
    pairs = (line.split() for line in lines)
    return {pair[0].rstrip(":"): int(pair[1]) for pair in pairs if len(pair) > 1 and pair[1].isdecimal()}


def _number(path: Path) -> int | None:
    try:
        text = path.read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdecimal() else None
