"""What a bundle brings along stays in its folder, and ends with its time."""

import io
import tarfile
from collections.abc import Iterator
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from random import Random

import pytest

from specs.errors import BundleRefused
from tasks.deploy.rollout.controller import ask_robot
from tasks.storage.archives import digest_of, install
from tasks.storage.base.keys import bundle_key
from tests.deploy.one_robot import GOOD, NAME, OneRobot, desired, scripted
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.promises.mortal import process, serve
from tests.deploy.yard import Yard, command_line, programs_of, wait_for_report
from tests.servers.eventually import eventually
from tests.storage.test_archives import CORPUS

pytestmark = pytest.mark.integration
_NAMES = ("a", "b", "..", ".", "", "~", "\\", "a" * 200, "con", "\n", "é", "current", "/")
_TYPES = (tarfile.REGTYPE, tarfile.REGTYPE, tarfile.DIRTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE)
_LINKS = ("..", "/etc", "a", "../../escaped", "/")
SURVIVORS = {
    "hangs": "sleep 3141\n",
    "does not hear": "trap '' TERM HUP INT\nsleep 3141\nsleep 3141\n",
    "leaves a child": "sleep 3141 &\n",
    "leaves a daemon": "setsid sleep 3141 </dev/null >/dev/null 2>&1 &\n",
    "leaves a daemon's child": "setsid sh -c 'sh -c \"sleep 3141\" &' &\n",
    "starts them faster than one counts": "for i in 1 2 3 4 5 6 7 8 9; do (setsid sleep 3141 &) ; done\nsleep 3141\n",
    "forgets its variables": "env -i setsid sleep 3141 </dev/null >/dev/null 2>&1 &\n",
    "forks while it is ended": "trap 'setsid sleep 3141 &' TERM\nwhile true; do sleep 0.05; done\n",
}


@sizes(short=1, long=5)
def test_no_archive_of_the_corpus_gets_out_of_its_folder(
    yard: Yard, size: int, figures: Figures, tmp_path: Path
) -> None:
    one = OneRobot(yard)
    good = yard.publish(GOOD)
    one.deploy(good, 1)
    inside = tmp_path / "inside"
    inside.mkdir()
    for number, make in enumerate([*CORPUS.values()] * size):
        archive = make(inside)
        digest = digest_of(archive)
        yard.store.upload(bundle_key(digest), archive)
        archive.unlink()
        before = _outside(tmp_path, one.root)

        told = one.deploy(good, number + 2, digest=digest)

        assert (told.status, told.failure_code) == ("Failed", "ExtractingBundleFailure")
        assert _outside(tmp_path, one.root) == before
        assert (yard.current(NAME), one.programs) == (good.digest, ["sleep 1000"])
    one.robot.end()
    figures(7, kind(yard.store.url), archives=size * len(CORPUS), escapes=0)


@sizes(short=100, long=20_000)
def test_no_random_archive_writes_outside(size: int, figures: Figures, tmp_path: Path) -> None:
    dice, refused = Random(size), 0  # noqa: S311 - what an archive holds
    place = tmp_path / "robot" / "versions"
    place.mkdir(parents=True)
    for number in range(size):
        archive = tmp_path / f"{number}.tar"
        _write_random(archive, dice)
        try:
            install(archive, digest_of(archive), place / str(number))
        except BundleRefused:
            refused += 1
        assert all(path.resolve().is_relative_to(place) and not path.is_symlink() for path in place.rglob("*"))
        archive.unlink()
        assert sorted(path.name for path in tmp_path.iterdir()) == ["robot"]
        assert [path.name for path in place.parent.iterdir()] == ["versions"]
        _emptied(place)
    assert 0 < refused < size
    figures(7, "file", random_archives=size, refused=refused, escapes=0)


@pytest.fixture
def agent(yard: Yard) -> Iterator[ForkServerProcess]:
    root = yard.root(NAME)
    root.mkdir(parents=True)
    started = process(serve, yard.store.url, str(root), 0)
    yield started
    started.kill()
    started.join()


@sizes(short=1, long=20)
def test_no_script_leaves_anything_behind(yard: Yard, size: int, figures: Figures, agent: ForkServerProcess) -> None:
    files = {f"{number}.sh": f"#!/bin/sh\n{body}" for number, body in enumerate(SURVIVORS.values())}
    version = yard.publish({**GOOD, **files})
    sequence = 0
    for _ in range(size):
        for name in files:
            sequence += 1
            wanted = ask_robot(
                yard.store, desired(version, sequence, launch=scripted(preLaunchFile=name), timeout_s=0.3)
            )
            wait_for_report(
                yard, NAME, lambda told, wanted=wanted: told.sequence == wanted.sequence and told.status != "Deploying"
            )
            eventually(lambda: not _sleepers())
    assert agent.is_alive()
    assert programs_of(yard.root(NAME)) == ["sleep 1000"]
    figures(7, kind(yard.store.url), scripts=sequence, survivors=0)


def _sleepers() -> list[str]:
    """Returns every process of this machine that a script of this test left, whatever it has done to its variables."""
    return [line for each in Path("/proc").glob("[0-9]*") if "sleep 3141" in (line := command_line(each))]


def _outside(folder: Path, root: Path) -> list[Path]:
    """Returns all files but those that a robot keeps for itself, and the store's."""
    own = {root / name for name in ("versions", "logs", "downloads", "state.json", "trust")}
    return sorted(
        path
        for path in folder.rglob("*")
        if not path.is_relative_to(folder / "store") and not any(path.is_relative_to(each) for each in own)
    )


def _write_random(path: Path, dice: Random) -> None:
    with tarfile.open(path, "w") as tar:
        for _ in range(dice.randint(1, 4)):
            member = tarfile.TarInfo("/".join(dice.choices(_NAMES, k=dice.randint(1, 3))))
            member.type = dice.choice(_TYPES)
            member.mode = dice.choice([0o644, 0o755, 0o4755, 0])
            body = b"x" * dice.randint(0, 20)
            if member.isreg():
                member.size = len(body)
            elif member.issym() or member.islnk():
                member.linkname = dice.choice(_LINKS)
            tar.addfile(member, io.BytesIO(body))


def _emptied(place: Path) -> None:
    for path in sorted(place.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
