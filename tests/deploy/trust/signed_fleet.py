"""A store with keys, a bundle and a robot that verifies, for tests of trust."""

import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.robot.disk import Disk
from tasks.deploy.robot.launch import LaunchPlace
from tasks.deploy.robot.processes import Stop
from tasks.deploy.robot.reported_state import Reporter
from tasks.deploy.robot.update import RobotUpdater
from tasks.deploy.rollout.controller import ask_robot
from tasks.deploy.trust.keyring import Keyring, Role
from tasks.deploy.trust.repository import init_keys, open_repository, renew_metadata, rotate_key
from tasks.deploy.trust.signer import DeploymentSigner
from tasks.deploy.trust.trust_record import Admission
from tasks.deploy.trust.verification import Verifier
from tasks.storage.base.keys import desired_key, trust_key
from tasks.storage.base.store import Store
from tests.deploy.one_robot import GOOD, NAME, desired
from tests.deploy.yard import FLEET, Yard, programs_of

OLDER = {"run.sh": GOOD["run.sh"] + "# older\n"}
NEWER = {"run.sh": GOOD["run.sh"] + "# newer\n"}


class Clock:
    """A clock that is so many days from now."""

    def __init__(self) -> None:
        self.days = 0.0

    def __call__(self) -> datetime:
        return datetime.now(UTC) + timedelta(days=self.days)


class Owner:
    """Who has the keys."""

    def __init__(self, store: Store, folder: Path) -> None:
        self.store = store
        self.clock = Clock()
        self.folder = folder
        self.ring: Keyring = init_keys(store, folder)

    @property
    def signer(self) -> DeploymentSigner:
        return DeploymentSigner(self.store, self.ring, self.clock)

    @property
    def root(self) -> bytes:
        root = self.ring.root
        assert root is not None
        return root

    @property
    def repository(self) -> str:
        notes = self.ring.notes
        assert notes is not None
        return notes.repository

    def key(self, name: str) -> str:
        return trust_key(self.repository, name)

    def rotate(self, *roles: Role) -> None:
        for role in roles:
            with open_repository(self.store, self.ring, clock=self.clock) as session:
                rotate_key(session, role)

    def renew(self) -> Sequence[Role]:
        with open_repository(self.store, self.ring, clock=self.clock) as session:
            return renew_metadata(session)

    def signed(self, version: Version, sequence: int, **changes: object) -> Desired:
        wanted = desired(version, sequence, **changes)
        self.admit(version, wanted.deployment, wanted.robot)
        return self.signer.sign(wanted)

    def admit(self, version: Version, deployment: str = "dep-2", robot: str = NAME) -> None:
        """Puts a deployment to the robot's fleet in force, and vouches for the robot."""
        self.signer.admit(Admission(FLEET, deployment, [version.digest], robots=[robot], own=[robot]))

    def vouch(self, *robots: str) -> None:
        """Signs that robots belong to the fleet."""
        self.signer.sign_fleets(lambda fleets: fleets.enlisted(FLEET, robots))

    def metadata(self) -> dict[str, bytes]:
        return {key: self.store.get(key).body for key in self.store.keys(f"trust/{self.repository}")}

    def latest(self, role: str, *, back: int = 0) -> str:
        """Returns the key of a role's newest metadata, or of the one so many versions before."""
        if role == "timestamp":
            return self.key("timestamp.json")
        names = [key.rsplit("/", 1)[1].split(".") for key in self.metadata()]
        versions = sorted(int(version) for version, *rest in names if rest[0] == role)
        return self.key(f"{versions[-1 - back]}.{role}.json")

    def restore(self, objects: dict[str, bytes]) -> None:
        for key, body in objects.items():
            self.store.put(key, body)

    def verifier(self, folder: Path, root: bytes | None = None) -> Verifier:
        return Verifier(self.store, folder, root or self.root)


class CarefulRobot:
    """A robot that verifies, in the process of the test."""

    def __init__(self, yard: Yard, root_of_trust: bytes, now_s: Callable[[], float] = time.time) -> None:
        self.yard = yard
        self.folder = yard.root(NAME)
        self.disk = Disk(self.folder)
        self.check = Verifier(yard.store, self.folder / "trust", root_of_trust, now_s)
        place = LaunchPlace(robot=NAME, disk=self.disk, stop=Stop(), grace_s=0.05)
        self.robot = RobotUpdater(yard.store, place, Reporter(yard.store, NAME), self.check)

    def look(self, wanted: Desired | None = None) -> Reported:
        """Takes what is asked, or what lies in the store, and returns what it reports."""
        if wanted is None:
            body = self.yard.store.get(desired_key(NAME)).body
            wanted = Desired.model_validate_json(body)
        self.robot.accept(wanted)
        reported = read_reported(self.yard.store, NAME)
        assert reported is not None
        return reported

    @property
    def runs(self) -> tuple[str, int]:
        """The digest that is shown as current, and how many programs run."""
        return self.yard.current(NAME), len(programs_of(self.folder))


def asked(owner: Owner, version: Version, deployment: str, **changes: object) -> Desired:
    """Returns what the owner's controller wrote for the robot."""
    owner.admit(version, deployment)
    return ask_robot(owner.store, desired(version, 1, deployment=deployment, **changes), owner.signer.sign)


def refused(careful: CarefulRobot, installed: Version, reported: Reported, says: str) -> None:
    """Fails unless the robot has refused, said so, and runs what was installed."""
    assert (reported.status, reported.failure_code) == ("Failed", "BadPermissionError")
    assert says in reported.failure_reason
    assert reported.running_digest == installed.digest
    assert careful.runs == (installed.digest, 1)
    assert careful.disk.load().sequence == 1, "what is refused must not count as seen"
