"""A robot that verifies nothing: whoever writes to the store has it run what they like, and its agent shall hold."""

import hashlib
import io
import subprocess
import tarfile
import tempfile
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.robot.processes import end_all
from tasks.storage.base.store import encode_document
from tests.attacks.conftest import Owner, Writer
from tests.attacks.robot.verifying_robot import STAYS_UP, eventually, start_agent
from tests.deploy.yard import marked_by

KEEP = Callable[[subprocess.Popen[str]], subprocess.Popen[str]]


@dataclass
class TrustingRobot:
    """The robot r1.

    Attributes:
        root: Its folder, which every account of this machine can get to.
        agent: Its agent.
    """

    writer: Writer
    root: Path
    agent: subprocess.Popen[str]

    def ask(self, scripts: Mapping[str, str], *, bundle: bytes | None = None, **changes: object) -> Reported:
        """Returns how it went with a bundle of these scripts, or with these bytes as the bundle."""
        body = bundle or _bundle({"run.sh": STAYS_UP, **scripts})
        digest, sequence = hashlib.sha256(body).hexdigest(), time.time_ns() // 1_000_000
        self.writer.put(f"bundles/{digest}", body)
        fields: Mapping[str, object] = {
            "robot": "r1",
            "deployment": f"dep-{sequence}",
            "sequence": sequence,
            "epoch": 1,
            "application": "courier",
            "version": 1,
            "digest": digest,
            "launch": DeploymentLaunchConfig(packageName="courier", launchFile="run.sh"),
            "environment": {},
            "timeout_s": 5.0,
            "issued_at_s": 0.0,
        }
        self.writer.put("robots/r1/desired.json", encode_document(Desired.model_validate({**fields, **changes})))
        eventually(lambda: not self.lives or self._ended(sequence) is not None)
        ended = self._ended(sequence)
        assert ended, "the agent has ended"
        return ended

    @property
    def runs(self) -> list[int]:
        """The processes of its application."""
        return marked_by(self.root)

    @property
    def lives(self) -> bool:
        """Whether its agent has not ended."""
        return self.agent.poll() is None

    def log(self, step: str) -> bytes:
        """Returns what programs of a step have printed, as far as it was kept."""
        return b"".join(path.read_bytes() for path in sorted((self.root / "logs").glob(f"*-{step}.log")))

    def _ended(self, sequence: int) -> Reported | None:
        try:
            told = Reported.model_validate_json(self.writer.get("robots/r1/reported.json"))
        except KeyError:
            return None
        return told if told.sequence == sequence and told.status != "Deploying" else None


@contextmanager
def trusting_robot(owner: Owner, writer: Writer, keep: KEEP, **environment: str) -> Generator[TrustingRobot]:
    """Starts it, with these variables in its agent's environment, and ends all that it has started."""
    with tempfile.TemporaryDirectory(prefix="simyard-robot-") as folder:
        root = Path(folder)
        root.chmod(0o755)
        agent = keep(start_agent(owner, root, "--unsigned", **environment))
        try:
            yield TrustingRobot(writer, root, agent)
        finally:
            agent.terminate()
            agent.communicate()
            end_all(root)


def _bundle(scripts: Mapping[str, str]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        for name, text in scripts.items():
            member = tarfile.TarInfo(f"courier/{name}")
            member.mode, member.size = 0o755, len(text.encode())
            tar.addfile(member, io.BytesIO(text.encode()))
    return buffer.getvalue()
