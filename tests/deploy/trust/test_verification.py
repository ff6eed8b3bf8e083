"""What a robot verifies on stores of each kind, also ones that answer strangely, and what who takes over verifies."""

from pathlib import Path

import pytest

from specs.errors import StoreAccessDenied, StoreError, StoreUnreachable, TrustRefused
from tasks.deploy.trust.repository import init_keys
from tasks.deploy.trust.signer import DeploymentSigner
from tasks.deploy.trust.verification import Verifier
from tasks.storage.base.store import UNBOUNDED, Store, StoredObject
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import NEWER, Owner
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


class TestAnywhere:
    """The worst of it, on a folder and on a real S3 server."""

    def test_signed_is_accepted_changed_and_old_are_refused(self, anywhere: Owner, tmp_path: Path) -> None:
        yard = Yard(anywhere.store, tmp_path)
        good, newer = yard.publish(GOOD), yard.publish(NEWER)
        verify = anywhere.verifier(tmp_path / "robot")
        first = anywhere.signed(good, 1)
        verify(first)
        before = anywhere.metadata()
        second = anywhere.signed(newer, 2)
        verify(second)

        with pytest.raises(TrustRefused, match="changed after it was signed"):
            verify(first.model_copy(update={"digest": newer.digest}))
        anywhere.restore(before)
        with pytest.raises(TrustRefused, match="older than what this robot has seen"):
            verify(first)

    def test_keys_are_made_once_however_often(self, anywhere: Owner, store: Store) -> None:
        before = anywhere.metadata()

        again = init_keys(store, anywhere.folder)

        assert anywhere.metadata() == before
        assert DeploymentSigner(store, again).root_of_trust.read_bytes() == anywhere.root
