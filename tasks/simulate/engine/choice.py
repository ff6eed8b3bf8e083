"""The choice of the engine that runs a robot: made from its files alone, before JAX is imported.

A robot's episodes all run on one engine, chosen from its ``robot.xml``, its controller and the kind of device, so that
every chunk of a batch, and a batch that is resumed, gets the same one.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import cast

from specs.base import Spec
from specs.data.engine_name import EngineName
from tasks.simulate.devices import DeviceKind
from tasks.simulate.engine.engines import ENGINES, fastest_first
from tasks.simulate.host.controller_kind import ControllerKind
from tasks.simulate.refusal import RobotRefused

_CULPRIT = re.compile(r"robot\.xml: ([^:]*):")
_SHOWN = 3


class EngineChoice(Spec):
    """Which engine runs a robot application.

    Attributes:
        engine: Its name.
        device: What its controller, sensors and scenario run on, and its physics unless the engine runs on the host.
        why: For a person; names what stands in the way of faster engines.
        controller: How its controller is driven.
    """

    engine: EngineName
    device: DeviceKind
    why: str
    controller: ControllerKind = "jax"


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
                return EngineChoice(engine=engine, device=device, why=_why(asked, hindered), controller=controller)
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
