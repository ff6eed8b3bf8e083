"""The table of engines, one record each, and the choice of the engine that runs a robot.

A record says an engine's rank, how it reads a robot and makes a program, and what it costs. A robot's episodes all run
on one engine, chosen from its ``robot.xml``, its controller and the kind of device, so that every chunk of a batch, and
a batch that is resumed, gets the same one. What loads a robot is imported when one is loaded: to choose an engine, or
to predict its cost, imports no JAX.
"""
# ruff: noqa: PLC0415 - see above

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol, cast

from specs.base import Spec
from specs.field_types import EngineName
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.devices import DeviceKind
from tasks.simulate.host.declaration import ControllerKind

if TYPE_CHECKING:
    from tasks.simulate.engines.program import Program
    from tasks.simulate.host.controllers import HostApplication
    from tasks.simulate.lane.chunk_applications import Applications

_MIB = 1 << 20


class EngineCost(NamedTuple):
    """What an engine costs, as measured with the shipped applications in furnished apartments of two rooms.

    Attributes:
        compile_s: For a program that was never compiled, the first slice included.
        load_s: Likewise for one that lies in the cache.
        step_s: For a control step of however many lanes.
        lane_step_s: For each lane more.
        ready_s: To make an episode ready.
        base_bytes: Of a process with Prefect, JAX and the program.
        lane_bytes: For each lane more: the map and what the controller makes of it above all.
    """

    compile_s: float
    load_s: float
    step_s: float
    lane_step_s: float
    ready_s: float
    base_bytes: int
    lane_bytes: int


class ProgramLoader(Protocol):
    """Makes the program of a robot and its applications; compiles nothing yet."""

    def __call__(
        self, robot: Path, applications: "Applications", lanes: int, host: "HostApplication | None"
    ) -> "Program":
        """Returns the program.

        Args:
            robot: The ``robot.xml``.
            applications: The robot application and the scenario.
            lanes: At least so many.
            host: Of a controller that runs on the host; None for one that is JAX.

        Raises:
            RobotRefused: The engine cannot represent the robot.
        """
        ...


class Engine(NamedTuple):
    """All that the rest of Simyard knows of an engine.

    Attributes:
        rank: Its place among the engines by measured speed, 1 for the fastest, on each kind of device
            (docs/reference/engines.md).
        read: Reads a ``robot.xml``; raises RobotRefused, with the remedy, if the engine cannot represent the robot.
        load: Makes the program.
        why_slower: Says why the next engine is faster with a ``robot.xml`` on a CPU, nothing where this one is; raises
            RobotRefused as ``read`` does.
        cost: Measured on two cores of a Xeon at 2.x GHz, courier and delivery, 2026-11
            (benchmarks/simulation/plan.py); steps of ``mujoco`` and ``mjx`` follow from docs/reference/engines.md, for
            a processor as fast as that one.
    """

    rank: Mapping[DeviceKind, int]
    read: Callable[[Path], object]
    load: ProgramLoader
    cost: EngineCost
    why_slower: Callable[[Path], str] | None = None


def _read_planar(robot: Path) -> object:
    from tasks.simulate.engines.planar.planar_robot import planar_robot

    return planar_robot(robot)


def _load_planar(robot: Path, applications: "Applications", lanes: int, host: "HostApplication | None") -> "Program":
    from tasks.simulate.engines.compiled_program import compiled_program
    from tasks.simulate.engines.planar.planar_engine import planar_mechanics

    return compiled_program(planar_mechanics(robot), applications, lanes, host)


def _read_mjx(robot: Path) -> object:
    from tasks.simulate.engines.mjx.mjx_robot import load_robot

    return load_robot(robot)


def _why_mjx_is_slower(robot: Path) -> str:
    from tasks.simulate.engines.mjx.mjx_limits import why_slower_on_a_cpu

    return why_slower_on_a_cpu(robot)


def _load_mjx(robot: Path, applications: "Applications", lanes: int, host: "HostApplication | None") -> "Program":
    from tasks.simulate.engines.compiled_program import compiled_program
    from tasks.simulate.engines.mjx.mjx_engine import mjx_mechanics

    return compiled_program(mjx_mechanics(robot), applications, lanes, host)


def _read_mujoco(robot: Path) -> object:
    from tasks.simulate.engines.mujoco.world_stepper import host_robot

    return host_robot(robot)


def _load_mujoco(robot: Path, applications: "Applications", lanes: int, host: "HostApplication | None") -> "Program":
    from tasks.simulate.engines.mujoco.mujoco_engine import host_program

    return host_program(robot, applications, lanes, host)


ENGINES: Mapping[EngineName, Engine] = {
    "planar": Engine(
        rank={"cpu": 1, "gpu": 1},
        read=_read_planar,
        load=_load_planar,
        cost=EngineCost(6.5, 0.8, 90e-6, 4.5e-6, 1e-3, 900 * _MIB, _MIB),
    ),
    "mjx": Engine(
        rank={"cpu": 2, "gpu": 2},
        read=_read_mjx,
        load=_load_mjx,
        cost=EngineCost(11.0, 2.0, 90e-6, 12e-6, 1e-3, 1350 * _MIB, _MIB),
        why_slower=_why_mjx_is_slower,
    ),
    "mujoco": Engine(
        rank={"cpu": 3, "gpu": 3},
        read=_read_mujoco,
        load=_load_mujoco,
        cost=EngineCost(4.5, 0.5, 0.8e-3, 35e-6, 1e-3, 750 * _MIB, _MIB),
    ),
}
ENGINES_OF_SEVERAL: tuple[EngineName, ...] = ("planar",)
"""Those that drive several robots in a world."""
# The engine that the others are compared with: it represents every robot, and runs every controller.
REFERENCE: EngineName = "mujoco"


def fastest_first(device: DeviceKind) -> tuple[EngineName, ...]:
    """Returns the engines, fastest first.

    Args:
        device: What JAX will run on.
    """
    return tuple(sorted(ENGINES, key=lambda name: ENGINES[name].rank[device]))


_CULPRIT = re.compile(r"robot\.xml: ([^:]*):")
_SHOWN = 3


class EngineChoice(Spec):
    """Which engine runs a robot application.

    Attributes:
        engine: Its name.
        device: What its controller, sensors and scenario run on, and its physics unless the engine runs on the host.
        why: For a person; names what stands in the way of faster engines.
        controller: How its controller is driven.
        strange: What is strange in its ``robot.xml``, and drives all the same, for a person.
    """

    engine: EngineName
    device: DeviceKind
    why: str
    controller: ControllerKind = "jax"
    strange: tuple[str, ...] = ()


def choose_engine(asked: str, robot: Path, controller: ControllerKind, device: DeviceKind) -> EngineChoice:
    """Returns the engine that runs a robot application.

    Args:
        asked: ``auto``, or the engine that it must be.
        robot: The application's ``robot.xml``.
        controller: How the application is driven.
        device: What JAX will run on.

    Raises:
        RobotRefused: The engine that it must be cannot run it, or none can; says what is in the way, and the remedy.
    """
    from tasks.simulate.application.robot_file import strange_in_robot

    order = fastest_first(device) if asked == "auto" else (cast("EngineName", asked),)
    refusals: dict[EngineName, str] = {}
    hindered: list[str] = []
    for engine in order:
        try:
            slower = _why_slower(engine, asked, robot, device)
        except RobotRefused as refused:
            refusals[engine] = str(refused)
            hindered.append(f"{engine} cannot represent {_culprits(str(refused))}")
        else:
            if not slower:
                why, strange = _why(asked, hindered), strange_in_robot(robot)
                return EngineChoice(engine=engine, device=device, why=why, controller=controller, strange=strange)
            hindered.append(f"{engine} is slower: {slower}")
    raise RobotRefused("\n".join(dict.fromkeys(refusals.values())))


def _why_slower(engine: EngineName, asked: str, robot: Path, device: DeviceKind) -> str:
    """Returns why an engine that can run a robot is slower than the next; nothing where it is faster, or asked for.

    Raises:
        RobotRefused: The engine cannot run it.
    """
    rule = ENGINES[engine].why_slower
    if rule is not None and asked == "auto" and device == "cpu":
        return rule(robot)
    ENGINES[engine].read(robot)
    return ""


def _why(asked: str, hindered: Sequence[str]) -> str:
    if asked != "auto":
        return "asked for"
    if not hindered:
        return "the fastest of all"
    return f"the fastest for this robot: {', '.join(hindered)}"


def _culprits(refusal: str) -> str:
    """Returns the elements that a refusal names, without what is wrong with them."""
    named = list(dict.fromkeys(_CULPRIT.findall(refusal))) or [" ".join(refusal.split())]
    more = f" and {len(named) - _SHOWN} more" if len(named) > _SHOWN else ""
    return ", ".join(named[:_SHOWN]) + more
