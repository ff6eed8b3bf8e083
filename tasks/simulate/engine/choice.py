"""The choice of the engine that runs a robot: made from its files alone, before JAX is imported.

A robot's episodes all run on one engine, chosen from its ``robot.xml``, its controller and the kind of device, so that
every chunk of a batch, and a batch that is resumed, gets the same one.
"""

import ast
import re
from collections.abc import Mapping
from pathlib import Path
from typing import cast

from specs.base import Spec
from specs.pipeline.simulation_section import EngineName
from tasks.simulate.devices import DeviceKind
from tasks.simulate.engine.engines import ENGINES, fastest_first
from tasks.simulate.refusal import RobotRefused

_PLAIN = "jax"
_CULPRIT = re.compile(r"robot\.xml: ([^:]*):")
_SHOWN = 3


class EngineChoice(Spec):
    """Which engine runs a robot application.

    Attributes:
        engine: Its name.
        device: What its controller, sensors and scenario run on, and its physics unless the engine runs on the host.
        why: For a person; names what stands in the way of faster engines.
        plain: Whether its controller is plain Python.
    """

    engine: EngineName
    device: DeviceKind
    why: str
    plain: bool


def choose_engine(asked: str, robot: Path, module: Path, device: DeviceKind) -> EngineChoice:
    """Returns the engine that runs a robot application.

    Args:
        asked: ``auto``, or the engine that it must be.
        robot: The application's ``robot.xml``.
        module: The module of its controller.
        device: What JAX will run on.

    Raises:
        RobotRefused: The engine that it must be cannot run it, or none can; says what is in the way, and the remedy.
    """
    plain = is_plain_python(module)
    order = _order(asked, device, plain=plain)
    refusals: dict[EngineName, str] = {}
    for engine in order:
        try:
            ENGINES[engine].read(robot)
        except RobotRefused as refused:
            refusals[engine] = str(refused)
        else:
            return EngineChoice(engine=engine, device=device, why=_why(asked, refusals, plain=plain), plain=plain)
    raise RobotRefused("\n".join(dict.fromkeys(refusals.values())))


def is_plain_python(module: Path) -> bool:
    """Returns whether a controller's module says ``jax = False``: it is called as plain Python, lane by lane.

    It is read and not imported, so that planning runs no application's code.
    """
    try:
        statements = ast.parse(module.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return False  # what is wrong with it is told when it is imported
    return any(
        isinstance(each, ast.Assign)
        and [target.id for target in each.targets if isinstance(target, ast.Name)] == [_PLAIN]
        and isinstance(each.value, ast.Constant)
        and each.value.value is False
        for each in statements
    )


def _order(asked: str, device: DeviceKind, *, plain: bool) -> tuple[EngineName, ...]:
    if asked != "auto":
        engine = cast("EngineName", asked)
        if plain and not ENGINES[engine].plain:
            able = " or ".join(fastest_first(device, plain=True))
            raise RobotRefused(
                f"engine {engine}: the controller's module says jax = False, and plain Python runs on engine {able} "
                "only: set engine: auto, or make its step a JAX function"
            )
        return (engine,)
    return fastest_first(device, plain=plain)


def _why(asked: str, refusals: Mapping[EngineName, str], *, plain: bool) -> str:
    if asked != "auto":
        return "asked for"
    if plain:
        return "its controller is plain Python"
    if not refusals:
        return "the fastest of all"
    hindered = (f"{engine} cannot represent {_culprits(refusal)}" for engine, refusal in refusals.items())
    return f"the fastest for this robot: {', '.join(hindered)}"


def _culprits(refusal: str) -> str:
    """Returns the elements that a refusal names, without what is wrong with them."""
    named = list(dict.fromkeys(_CULPRIT.findall(refusal))) or [" ".join(refusal.split())]
    more = f" and {len(named) - _SHOWN} more" if len(named) > _SHOWN else ""
    return ", ".join(named[:_SHOWN]) + more
