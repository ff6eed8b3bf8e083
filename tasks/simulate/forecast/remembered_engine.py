"""The choice of a robot's engine, kept in the user's cache folder: to make it anew imports MuJoCo.

What is remembered is good for the same bundle and the same code. Nothing of it is ever part of a result: a batch that
runs chooses anew. A folder that cannot be written to is as good as no memory at all.
"""

import hashlib
import logging
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from pydantic import ValidationError

from specs.base import Spec
from tasks.simulate.devices import DeviceKind
from tasks.simulate.engine.choice import EngineChoice, choose_engine
from tasks.simulate.host.controller_kind import ControllerKind
from tasks.simulate.refusal import RobotRefused
from tasks.storage.base.atomic_file import whole_file
from tasks.storage.base.cache_folder import cache_folder

logger = logging.getLogger(__name__)
_CODE = Path(__file__).parents[1]


class EngineAnswer(Spec):
    """The engine of a robot application, or why there is none.

    Attributes:
        choice: None if no engine takes the robot.
        refusal: Why none does, with the remedies; or empty.
    """

    choice: EngineChoice | None
    refusal: str = ""


def recall_choice(asked: str, digest: str, robot: Path, controller: ControllerKind, device: DeviceKind) -> EngineAnswer:
    """Returns which engine runs a robot application.

    Args:
        asked: ``auto``, or the engine that it must be.
        digest: Of its bundle, which holds all that ``robot.xml`` refers to.
        robot: Its ``robot.xml``.
        controller: How it is driven.
        device: What JAX will run on.
    """
    path = _path([asked, digest, device, controller, *_contents((robot,)), *_code()])
    try:
        return EngineAnswer.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        answer = _chosen(asked, robot, controller, device)
    try:
        with whole_file(path) as file:
            file.write(answer.model_dump_json().encode())
    except OSError as exc:
        logger.debug("the engine is not remembered: %s", exc)
    return answer


def _chosen(asked: str, robot: Path, controller: ControllerKind, device: DeviceKind) -> EngineAnswer:
    try:
        return EngineAnswer(choice=choose_engine(asked, robot, controller, device))
    except RobotRefused as refused:
        return EngineAnswer(choice=None, refusal=str(refused))


def _contents(files: Sequence[Path]) -> Iterator[str]:
    for file in files:
        yield hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


def _code() -> Iterator[str]:
    """Yields what changes when an engine does: MuJoCo's version, and the size and age of each module here."""
    yield version("mujoco")
    for module in sorted(_CODE.rglob("*.py")):
        stat = module.stat()
        yield f"{module.relative_to(_CODE)} {stat.st_size} {stat.st_mtime_ns}"


def _path(parts: Sequence[str]) -> Path:
    return cache_folder() / "engines" / f"{hashlib.sha256(repr(parts).encode()).hexdigest()}.json"
