"""How much a store can make a robot read: no more than was signed, whatever it serves."""

from pathlib import Path

import pytest

from specs.errors import TrustRefused
from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.trust.verification import Verifier
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import UNBOUNDED, Store, StoredObject
from tests.deploy.one_robot import GOOD, NAME
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner, asked
from tests.deploy.yard import Yard


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
