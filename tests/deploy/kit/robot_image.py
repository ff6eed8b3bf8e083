"""A robot's file system in a folder, with the agent as its installer puts it there; nothing is downloaded for it.

What the agent may import from elsewhere is linked into its environment distribution by distribution, starting from
what its wheel asks for: something that the wheel forgets to ask for is not there.
"""

import os
import re
import subprocess
from importlib import metadata
from pathlib import Path

from tasks.deploy.kit.robot_kit import agent_requirements

_NAME = re.compile(r"[A-Za-z0-9._-]+")
_UNIT = "etc/systemd/system/simyard-agent@.service"


def install(kit: Path, image: Path, robot: str) -> str:
    """Returns what the installer printed, having installed a kit's agent into an image."""
    alone = {"DESTDIR": str(image), "PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    done = subprocess.run(
        [str(kit / "install.sh"), robot], env={**os.environ, **alone}, check=True, capture_output=True, text=True
    )
    (site,) = (image / "opt/simyard-agent/lib").glob("python*/site-packages")
    for name in _distributions():
        _link(name, site)
    return done.stdout


def command(image: Path, robot: str) -> list[str]:
    """Returns what the unit starts for a robot, in the image."""
    (start,) = re.findall(r"^ExecStart=(.*)$", (image / _UNIT).read_text(), flags=re.MULTILINE)
    settings = dict(re.findall(r'^(\w+)="?([^"\n]*)"?$', (image / "etc/simyard/agent.env").read_text(), re.MULTILINE))
    line = start.replace("%i", robot).replace("${SIMYARD_STORE}", settings["SIMYARD_STORE"])
    words = line.replace("$SIMYARD_TRUST", settings["SIMYARD_TRUST"]).split()
    return [f"{image}{word}" if word.startswith(("/opt", "/etc", "/var")) else word for word in words]


def environment(image: Path) -> dict[str, str]:
    """Returns an environment like that of a unit: no path to this repository, and none of its settings."""
    return {"PATH": os.environ["PATH"], "HOME": str(image)}


def _distributions() -> set[str]:
    left = [requirement for requirement in agent_requirements() if "extra ==" not in requirement]
    found: set[str] = set()
    while left:
        named = _NAME.match(left.pop())
        assert named
        if named[0] in found or not _installed(named[0]):
            continue
        found.add(named[0])
        left += [each for each in metadata.requires(named[0]) or () if "extra ==" not in each or "crypto" in each]
    return found


def _installed(name: str) -> bool:
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def _link(name: str, site: Path) -> None:
    distribution = metadata.distribution(name)
    for top in {file.parts[0] for file in distribution.files or () if ".." not in file.parts}:
        if not (site / top).exists():
            (site / top).symlink_to(Path(str(distribution.locate_file(top))))
