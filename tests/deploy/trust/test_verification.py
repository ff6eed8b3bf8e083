"""What a robot verifies on stores that answer strangely, at which lengths, and when its clock is wrong."""

import errno
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from specs.errors import StoreAccessDenied, StoreError, StoreUnreachable, TrustRefused
from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Reported
from tasks.deploy.robot.agent import Poll, serve
from tasks.deploy.robot.processes import Stop, StopRequested
from tasks.deploy.trust.repository import init_keys
from tasks.deploy.trust.signer import DeploymentSigner
from tasks.deploy.trust.verification import Verifier
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import UNBOUNDED, Store, StoredObject
from tests.deploy.one_robot import GOOD, NAME
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner, asked
from tests.deploy.yard import Yard


class _StrictStore:
    """A store that answers 403 for what is not there, as S3 does to who may not list, or that is away."""

    def __init__(self, store: Store, error: type[StoreError], names: str) -> None:
        self.url = store.url
        self._store = store
        self._error = error
        self._names = names

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        if self._names in key:
            raise self._error("no")
        return self._store.get(key, most_bytes)


def test_a_robot_that_may_not_list_verifies(owner: Owner, yard: Yard, tmp_path: Path) -> None:
    strict = _StrictStore(yard.store, StoreAccessDenied, ".root.json")
    verify = Verifier(strict, tmp_path / "robot", owner.root)  # pyright: ignore[reportArgumentType] - reads alone

    verify(owner.signed(yard.publish(GOOD), 1))


@pytest.mark.parametrize("error", [StoreUnreachable, StoreAccessDenied])
@pytest.mark.parametrize("name", ["timestamp", "deployer"])
def test_a_store_that_is_away_refuses_nothing_and_accepts_nothing(
    error: type[StoreError], name: str, owner: Owner, yard: Yard, tmp_path: Path
) -> None:
    away = _StrictStore(yard.store, error, name)
    verify = Verifier(away, tmp_path / "robot", owner.root)  # pyright: ignore[reportArgumentType] - reads alone

    with pytest.raises(error):
        verify(owner.signed(yard.publish(GOOD), 1))


def test_a_changed_plan_is_not_signed_by_who_takes_over(owner: Owner) -> None:
    signer = owner.signer
    plan = signer.sign_plan(b'{"job":"dep-1","plan":{"digest":"a"}}')
    signer.check_plan(b'{"job":"dep-1","plan":{"digest":"a"}}', plan)

    with pytest.raises(TrustRefused, match="changed after it was signed"):
        signer.check_plan(b'{"job":"dep-1","plan":{"digest":"b"}}', plan)


class _Looks(Stop):
    """Lets an agent look a few times; after one of the looks something happens."""

    def __init__(self, looks: int, after: int, happens: Callable[[], None]) -> None:
        super().__init__()
        self._looks, self._after, self._happens = looks, after, happens
        self.reports: list[Reported | None] = []
        self.report: Callable[[], Reported | None] = lambda: None

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.reports.append(self.report())
        if len(self.reports) == self._after:
            self._happens()
        if len(self.reports) == self._looks:
            raise StopRequested


@pytest.mark.parametrize("was_begun", [False, True])
def test_a_robot_whose_clock_was_wrong_at_its_start_asks_again_and_reports_once(
    owner: Owner, yard: Yard, careful: CarefulRobot, installed: Version, *, was_begun: bool
) -> None:
    newer = yard.publish(NEWER)
    wanted = asked(owner, newer, "next")
    if was_begun:  # and the power failed in the middle
        state = careful.disk.load()
        accepted = {"sequence": wanted.sequence, "deployment": "next", "epoch": wanted.epoch, "target": wanted}
        careful.disk.save(state.model_copy(update=accepted))
    careful.robot.end()
    clock = [time.time() + 400 * 86_400.0]
    again = CarefulRobot(yard, owner.root, lambda: clock[0])
    looks = _Looks(8, 4, lambda: clock.__setitem__(0, time.time()))
    looks.report = lambda: read_reported(yard.store, NAME)

    with pytest.raises(StopRequested):
        serve(again.robot, yard.store, NAME, looks, Poll(0.0, 0.0, Random(1)))  # noqa: S311 - jitter

    try:
        early, late = looks.reports[:4], looks.reports[4:]
        assert {each and (each.deployment, each.status) for each in early} == {("next", "Failed")}
        assert len({each.finished_at_s for each in early if each}) == 1, "it is reported once"
        assert {each and (each.deployment, each.status) for each in late} == {("next", "InSync")}
        assert again.runs == (newer.digest, 1)
    finally:
        again.robot.end()


def test_keys_are_made_once_however_often(owner: Owner) -> None:
    before = owner.metadata()

    again = init_keys(owner.store, owner.folder)

    assert owner.metadata() == before
    assert DeploymentSigner(owner.store, again).root_of_trust.read_bytes() == owner.root


def test_the_keys_vouch_for_a_bundles_length(owner: Owner, yard: Yard, tmp_path: Path) -> None:
    version = yard.publish(GOOD)

    assert owner.verifier(tmp_path / "trust")(owner.signed(version, 1)) == version.size_bytes


def test_a_bundle_that_has_grown_is_refused_before_it_is_written(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    wanted = asked(owner, newer, "next")
    yard.store.put(bundle_key(newer.digest), yard.store.get(bundle_key(newer.digest)).body + b"x")

    reported = careful.look(wanted)

    assert (reported.failure_code, reported.step) == ("EtagMismatch", "DownloadingExtracting")
    assert f"more than the {newer.size_bytes}" in reported.failure_reason
    assert careful.runs == (installed.digest, 1)


def test_the_length_is_known_after_a_restart(yard: Yard, owner: Owner, careful: CarefulRobot) -> None:
    newer = yard.publish(NEWER)
    careful.look(asked(owner, newer, "next"))
    state = careful.disk.load()
    assert state.length_bytes == newer.size_bytes
    careful.robot.end()
    other = yard.publish({"run.sh": NEWER["run.sh"] + "# again\n"})
    wanted = asked(owner, other, "again")
    length = owner.verifier(careful.folder / "trust")(wanted)
    careful.disk.save(state.model_copy(update={"sequence": wanted.sequence, "target": wanted, "length_bytes": length}))
    yard.store.put(bundle_key(other.digest), b"x" * (other.size_bytes + 1))

    again = CarefulRobot(yard, owner.root)
    again.robot.recover()

    reported = read_reported(yard.store, NAME)
    assert reported is not None
    assert "more than the" in reported.failure_reason
    again.robot.end()


@pytest.mark.parametrize("name", ["timestamp", "snapshot", "targets", "deployer"])
def test_metadata_that_never_ends_is_refused(name: str, owner: Owner, yard: Yard, tmp_path: Path) -> None:
    wanted = owner.signed(yard.publish(GOOD), 1)
    key = owner.latest(name)
    yard.store.put(key, yard.store.get(key).body + b" " * 6_000_000)

    with pytest.raises(TrustRefused, match="not the file that was signed for"):
        owner.verifier(tmp_path / "trust")(wanted)


class _Noting:
    """A store that notes how much is read at most."""

    def __init__(self, store: Store) -> None:
        self.bounds: list[int] = []
        self._store = store

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        self.bounds.append(most_bytes)
        return self._store.get(key, most_bytes)


def test_no_metadata_is_read_without_a_bound(owner: Owner, yard: Yard, tmp_path: Path) -> None:
    noting = _Noting(yard.store)
    verify = Verifier(noting, tmp_path / "trust", owner.root)  # pyright: ignore[reportArgumentType] - reads alone

    verify(owner.signed(yard.publish(GOOD), 1))

    assert noting.bounds
    assert max(noting.bounds) <= 5_000_000


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EDQUOT])
def test_a_full_disk_of_the_robot_is_no_refusal_of_what_was_signed(
    code: int, owner: Owner, yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verify, state = Verifier(yard.store, tmp_path / "robot", owner.root), owner.signed(yard.publish(GOOD), 1)

    def full(*_: object, **__: object) -> None:
        raise OSError(code, "the disk says no")

    with monkeypatch.context() as patched:
        patched.setattr("tuf.ngclient.updater.tempfile.NamedTemporaryFile", full)
        with pytest.raises(OSError, match="the disk says no"):
            verify(state)
    verify(state)
