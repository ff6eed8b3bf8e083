"""A fleet of one robot, which verifies, with its agent as the command starts it; and what it runs."""

import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.attacks.conftest import Owner
from tests.deploy.yard import marked_by

DOCUMENT = """name: by-hand
deployment:
  fleet: couriers
  deploymentApplicationConfigs:
    - application: courier
      launchConfig: {packageName: courier, launchFile: run.sh}
"""
STAYS_UP = "#!/bin/sh\nexec sleep 1000\n"
_PATIENCE_S = 60.0


@dataclass
class VerifyingRobot:
    """The robot r1.

    Attributes:
        root: Its folder, which every account of this machine can get to.
        agent: Its agent.
    """

    owner: Owner
    root: Path
    agent: subprocess.Popen[str]

    def deploy(self, script: str = STAYS_UP, **files: str) -> subprocess.CompletedProcess[str]:
        """Returns the ended command that rolled out a version with this script."""
        publish(self.owner, script, **files)
        return self.owner.simyard("run", "by-hand.yaml", SIMYARD_KEYS="keys")

    @property
    def runs(self) -> list[int]:
        """The processes of its application."""
        return marked_by(self.root)

    @property
    def lives(self) -> bool:
        """Whether its agent has not ended."""
        return self.agent.poll() is None

    def looks(self) -> None:
        """Waits until the agent has looked at the store some times."""
        until_s = time.monotonic() + 2.0
        while self.lives and time.monotonic() < until_s:
            time.sleep(0.1)


def set_up(owner: Owner) -> None:
    """Makes keys, and a fleet with the robot r1."""
    for arguments in (["keys", "init", "--keys", "keys"], ["create", "couriers"], ["register", "couriers", "r1"]):
        done = owner.simyard("fleet", *arguments, SIMYARD_KEYS="keys")
        assert done.returncode == 0, done.stdout
    (owner.folder / "by-hand.yaml").write_text(DOCUMENT)


def publish(owner: Owner, script: str, **files: str) -> None:
    """Publishes a version whose package holds the script, and others under their names."""
    package = owner.folder / "bundle" / "courier"
    package.mkdir(parents=True, exist_ok=True)
    for name, text in {"run.sh": script, **{f"{name}.sh": text for name, text in files.items()}}.items():
        (package / name).write_text(text)
        (package / name).chmod(0o755)
    done = owner.simyard("app", "publish", "courier", "bundle")
    assert done.returncode == 0, done.stdout


def start_agent(
    owner: Owner, root: Path, trust: str = "--root-of-trust=keys/root.json", **environment: str
) -> subprocess.Popen[str]:
    """Returns the agent's process, which looks at the store several times a second."""
    arguments = ["--robot=r1", f"--root={root}", f"--store={owner.url}", trust]
    return owner.start("agent", *arguments, "--poll-s=0.1", "--longest-poll-s=0.3", "--grace-s=0.2", **environment)


def eventually(condition: Callable[[], bool]) -> None:
    """Waits until the condition holds, and fails if it never does."""
    until_s = time.monotonic() + _PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s, "it never happened"
        time.sleep(0.05)
