"""The two sides of an attack: the owner, who has the ``simyard`` command, and the writer, who has the store.

An attack uses nothing else, so that it can be tried on another version of Simyard as well:
``SIMYARD_ATTACKED=/path/to/its/.venv/bin/simyard pytest tests/attacks`` fails wherever that version gives way.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol
from uuid import uuid4

import pytest

from tests.attacks.bucket_writer import BucketWriter, allow_writer
from tests.integration.runs import own_cache
from tests.servers.seaweed import Seaweed

_ATTACKED = "SIMYARD_ATTACKED"
_ENOUGH_S = 280.0
# Of the machine that runs the tests, and none of the owner's.
_NOT_THE_OWNERS = frozenset({"SIMYARD_STORE", "SIMYARD_KEYS", "SIMYARD_BUCKETS", "SIMYARD_WORKERS"})


class Writer(Protocol):
    """Somebody who can read and write every object of the store, and has nothing else."""

    def get(self, key: str) -> bytes:
        """Returns an object's bytes; raises KeyError where there is none."""
        ...

    def put(self, key: str, body: bytes) -> None:
        """Writes an object, over what was there."""
        ...

    def delete(self, key: str) -> None:
        """Removes an object."""
        ...

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys of all objects below a prefix, sorted."""
        ...


@dataclass(frozen=True)
class FolderWriter:
    """Writes into a folder store, as another account with the same group would."""

    folder: Path

    def get(self, key: str) -> bytes:
        """Returns an object's bytes."""
        try:
            return (self.folder / key).read_bytes()
        except FileNotFoundError as exc:
            raise KeyError(key) from exc

    def put(self, key: str, body: bytes) -> None:
        """Writes an object."""
        path = self.folder / key
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(f"{path.name}.{uuid4().hex}")
        new.write_bytes(body)
        new.replace(path)

    def delete(self, key: str) -> None:
        """Removes an object."""
        (self.folder / key).unlink()

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys of all objects below a prefix."""
        files = (str(path.relative_to(self.folder)) for path in self.folder.rglob("*") if path.is_file())
        return sorted(key for key in files if key.startswith(prefix))


@dataclass(frozen=True)
class Owner:
    """Somebody who uses ``simyard`` as its documents say.

    Attributes:
        url: The store.
        folder: The working directory, outside the store.
        environment: Of each command.
    """

    url: str
    folder: Path
    environment: Mapping[str, str] = field(repr=False)

    def start(self, *arguments: str, **environment: str) -> subprocess.Popen[str]:
        """Returns the command, started in a session of its own, both outputs in one pipe."""
        return subprocess.Popen(
            [*_command(), *arguments],
            cwd=self.folder,
            env={**self.environment, **environment},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def simyard(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Returns the command, ended; ``stdout`` has both of its outputs.

        Raises:
            TimeoutExpired: It does not end.
        """
        process = self.start(*arguments, **environment)
        try:
            out, _ = process.communicate(timeout=_ENOUGH_S)
        finally:
            process.kill()
        return subprocess.CompletedProcess(arguments, process.returncode, out, "")


def _command() -> Sequence[str]:
    attacked = os.environ.get(_ATTACKED)
    return [attacked] if attacked else [str(Path(sys.executable).with_name("simyard"))]


@pytest.fixture(scope="session")
def attack_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The owner's cache folder; one for all attacks."""
    return Path(own_cache(tmp_path_factory.mktemp("attack-cache")))


@pytest.fixture(scope="session")
def attacked_bucket(seaweed: Seaweed) -> str:
    """A bucket that the writer may write to, and to no other, as the bucket's policy says."""
    allow_writer(seaweed, "attacked")
    return "attacked"


@pytest.fixture(params=["file", "s3"])
def attacked_store(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Writer, Mapping[str, str]]:
    """A new store of each kind: its URL, who writes to it, and the environment in which the owner reaches it."""
    if request.param == "file":
        folder = tmp_path / "store"
        folder.mkdir()
        return folder.as_uri(), FolderWriter(folder), {}
    server: Seaweed = request.getfixturevalue("seaweed")
    bucket, prefix = request.getfixturevalue("attacked_bucket"), uuid4().hex
    return f"s3://{bucket}/{prefix}", BucketWriter(server, bucket, prefix), server.environment()


@pytest.fixture
def owner(
    attacked_store: tuple[str, Writer, Mapping[str, str]], tmp_path: Path, attack_cache: Path, prefect_server: str
) -> Owner:
    """The owner, in an empty folder."""
    url, _, reach = attacked_store
    folder = tmp_path / "owner"
    folder.mkdir()
    kept = {name: value for name, value in os.environ.items() if name not in _NOT_THE_OWNERS}
    if os.environ.get(_ATTACKED):
        kept.pop("PYTHONPATH", None)  # or it would be this version that is attacked
    return Owner(url, folder, {**kept, **reach, "SIMYARD_STORE": url, "SIMYARD_CACHE": str(attack_cache)})


@pytest.fixture
def writer(attacked_store: tuple[str, Writer, Mapping[str, str]]) -> Writer:
    """The attacker."""
    return attacked_store[1]


@pytest.fixture
def stop_later() -> Iterator[Callable[[subprocess.Popen[str]], subprocess.Popen[str]]]:
    """Ends each process that it is given when the test is over, with all that those have started."""
    begun: list[subprocess.Popen[str]] = []

    def keep(process: subprocess.Popen[str]) -> subprocess.Popen[str]:
        begun.append(process)
        return process

    yield keep
    for process in begun:
        process.terminate()
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
