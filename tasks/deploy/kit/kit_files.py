"""The kit's files: the agent's wheel, the installer, the unit, the robot's settings and the root of trust."""

import shlex
from importlib.resources import files
from pathlib import Path

from specs.base import Fault
from specs.errors import DocumentError
from tasks.deploy.kit.wheel import agent_wheel, wheel_name
from tasks.deploy.trust.trust_choice import UNSIGNED_ALARM

_ROBOT = files("tasks.deploy.kit") / "robot"
_UNIT = "simyard-agent@.service"
_INSTALLER = "install.sh"
_ROOT_OF_TRUST = "root.json"


def write_kit(folder: Path, *, store_url: str, root_of_trust: bytes | None) -> tuple[Path, ...]:
    """Writes what a robot needs into a folder, made if it is missing; returns the files.

    The kit names no robot, so that one serves a fleet, and holds no secret.

    Args:
        folder: Where to.
        store_url: Where robots look, as seen from them.
        root_of_trust: ``root.json`` of the keys; None for robots that verify nothing.

    Raises:
        DocumentError: The folder holds something else.
    """
    settings = _settings(store_url, signed=root_of_trust is not None)
    contents = {
        wheel_name(): agent_wheel(),
        _UNIT: (_ROBOT / _UNIT).read_bytes(),
        _INSTALLER: (_ROBOT / _INSTALLER).read_bytes(),
        "agent.env": settings.encode(),
        **({_ROOT_OF_TRUST: root_of_trust} if root_of_trust is not None else {}),
    }
    _refuse_foreign(folder, set(contents) | {_ROOT_OF_TRUST})
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    for name, body in contents.items():
        (folder / name).write_bytes(body)
    (folder / _INSTALLER).chmod(0o755)
    return tuple(folder / name for name in contents)


def _refuse_foreign(folder: Path, ours: set[str]) -> None:
    if not folder.exists():
        return
    there = [path.name for path in folder.iterdir()] if folder.is_dir() else [""]
    if not all(name in ours or _is_wheel(name) for name in there):
        allowed = "a folder that is new, empty, or holds an older kit"
        raise DocumentError([Fault(path="FOLDER", value=str(folder), allowed=allowed)])


def _is_wheel(name: str) -> bool:
    return name.partition("-")[0] == wheel_name().partition("-")[0] and name.endswith(".whl")


def _settings(store_url: str, *, signed: bool) -> str:
    """Returns the environment of the unit; systemd splits SIMYARD_TRUST into words."""
    trust = f"--root-of-trust /etc/simyard/{_ROOT_OF_TRUST}" if signed else "--unsigned"
    lines = [] if signed else [f"# {UNSIGNED_ALARM}"]
    lines += [
        f"SIMYARD_STORE={shlex.quote(store_url)}",
        f'SIMYARD_TRUST="{trust}"',
        "# A store on S3 needs these, too; this file is readable by root alone.",
        "#AWS_ACCESS_KEY_ID=",
        "#AWS_SECRET_ACCESS_KEY=",
        "#AWS_ENDPOINT_URL=",
        "",
    ]
    return "\n".join(lines)
