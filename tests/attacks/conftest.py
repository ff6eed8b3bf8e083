"""The two sides of an attack: the owner, who has the ``simyard`` command, and the writer, who has the store.

An attack is tested where its defence is; here are those whose defence is the whole command. They use nothing else, so
that they can be tried on another version of Simyard as well:
``SIMYARD_ATTACKED=/path/to/its/.venv/bin/simyard pytest tests/attacks`` fails wherever that version gives way.
"""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from uuid import uuid4

import pytest
from botocore.exceptions import ClientError

from tasks.storage.store_url import open_store
from tests.integration.runs import own_cache

_ATTACKED = "SIMYARD_ATTACKED"
# Of the machine that runs the tests, and none of the owner's.
_NOT_THE_OWNERS = frozenset({"SIMYARD_STORE", "SIMYARD_KEYS", "SIMYARD_BUCKETS", "SIMYARD_WORKERS"})


@dataclass(frozen=True)
class Writer:
    """Somebody who can read and write every object of a store, as another account with the same group would.

    Attributes:
        url: The store.
    """

    url: str

    @property
    def folder(self) -> Path | None:
        """The store's folder; None of a bucket."""
        return Path(self.url.removeprefix("file://")) if self.url.startswith("file://") else None

    def get(self, key: str) -> bytes:
        """Returns an object's bytes."""
        return (self.folder / key).read_bytes() if self.folder else open_store(self.url).get(key).body

    def put(self, key: str, body: bytes) -> None:
        """Writes an object, over what was there; a file is one that may be run."""
        if self.folder is None:
            open_store(self.url).put(key, body)
            return
        path = self.folder / key
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(f"{path.name}.{uuid4().hex}")
        new.write_bytes(body)
        new.chmod(0o755)
        new.replace(path)

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys of all objects below a prefix, sorted."""
        if self.folder is None:
            return sorted(open_store(self.url).keys(prefix))
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

    def start(self, *arguments: str, around: bool = False, **environment: str) -> subprocess.Popen[str]:
        """Returns the command, started in a session of its own, both outputs in one pipe.

        Args:
            arguments: Of `simyard`.
            around: Whether its Python is called by a path that has ``..`` in it.
            environment: Variables beside the owner's own.
        """
        return subprocess.Popen(
            [*_command(around=around), *arguments],
            cwd=self.folder,
            env={**self.environment, **environment},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def simyard(self, *arguments: str, around: bool = False, **environment: str) -> subprocess.CompletedProcess[str]:
        """Returns the command, ended; ``stdout`` has both of its outputs."""
        process = self.start(*arguments, around=around, **environment)
        try:
            out, _ = process.communicate()
        finally:
            process.kill()
        return subprocess.CompletedProcess(arguments, process.returncode, out, "")


def _command(*, around: bool = False) -> Sequence[str]:
    command = Path(os.environ.get(_ATTACKED) or Path(sys.executable).with_name("simyard"))
    python = command.parent / ".." / command.parent.name / "python"
    return [str(python), "-m", "simyard"] if around else [str(command)]


def attacked_python() -> str:
    """Returns the interpreter of the version that is attacked."""
    return str(Path(_command()[0]).with_name("python"))


def attacked_environment() -> dict[str, str]:
    """Returns this machine's environment for a program of the version that is attacked, without what is the owner's."""
    kept = {name: value for name, value in os.environ.items() if name not in _NOT_THE_OWNERS}
    if os.environ.get(_ATTACKED):
        kept.pop("PYTHONPATH", None)  # or it would be this version that is attacked
    return kept


@pytest.fixture(scope="session")
def attack_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The owner's cache folder; one for all attacks."""
    return Path(own_cache(tmp_path_factory.mktemp("attack-cache")))


@pytest.fixture(params=["folder", pytest.param("bucket", marks=pytest.mark.soak)])
def writer(request: pytest.FixtureRequest, tmp_path: Path) -> Writer:
    """The attacker, in a new store: a folder, and a bucket of SeaweedFS."""
    if request.param == "folder":
        (tmp_path / "store").mkdir()
        return Writer((tmp_path / "store").as_uri())
    url = request.getfixturevalue("s3_url")()
    with suppress(ClientError):  # another attack has made it
        request.getfixturevalue("seaweed").make_bucket("results")
    return Writer(url)


@pytest.fixture
def owner(writer: Writer, tmp_path: Path, attack_cache: Path, prefect_server: str) -> Owner:
    """The owner, in an empty folder."""
    folder = tmp_path / "owner"
    folder.mkdir()
    return Owner(
        writer.url, folder, {**attacked_environment(), "SIMYARD_STORE": writer.url, "SIMYARD_CACHE": str(attack_cache)}
    )
