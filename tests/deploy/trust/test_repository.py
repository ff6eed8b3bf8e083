"""The owner's work on the metadata."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.errors import DocumentError, TrustRefused
from tasks.deploy.trust.keyring import ROLES, Role
from tasks.deploy.trust.repository import LIFETIMES, init_keys, open_repository
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD, desired
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import Yard

_OPERATIONS = st.lists(st.sampled_from([*ROLES, "renew", "admit"]), min_size=1, max_size=6)


def _hide(owner: Owner, *roles: Role) -> None:
    """Takes keys away, as to where they are kept offline."""
    for role in roles:
        for path in owner.folder.glob(f"{role}-*.pem"):
            path.rename(owner.folder.parent / path.name)


@pytest.mark.parametrize("role", ROLES)
def test_a_replaced_key_is_not_the_old_one_and_its_file_is_gone(role: Role, owner: Owner) -> None:
    (before,) = owner.folder.glob(f"{role}-*.pem")

    owner.rotate(role)

    (after,) = owner.folder.glob(f"{role}-*.pem")
    assert after != before


def test_a_deployment_needs_neither_roots_nor_targets_key(owner: Owner, yard: Yard, tmp_path: Path) -> None:
    _hide(owner, "root", "targets")

    owner.verifier(tmp_path / "robot")(owner.signed(yard.publish(GOOD), 1))
    assert owner.renew() == []


@pytest.mark.parametrize(
    ("role", "needed"), [("deployer", "targets"), ("snapshot", "root"), ("targets", "root"), ("root", "root")]
)
def test_a_key_is_replaced_by_who_has_the_one_above_it(role: Role, needed: Role, owner: Owner) -> None:
    _hide(owner, needed)
    before = owner.metadata()

    with pytest.raises(DocumentError, match="from where you keep it offline"):
        owner.rotate(role)

    assert owner.metadata() == before


@pytest.mark.parametrize("role", ["snapshot", "timestamp", "targets", "deployer"])
def test_a_key_that_was_lost_is_replaced(role: Role, owner: Owner, yard: Yard, tmp_path: Path) -> None:
    version = yard.publish(GOOD)
    verify = owner.verifier(tmp_path / "robot")
    verify(owner.signed(version, 1))
    _hide(owner, role)

    owner.rotate(role)

    verify(owner.signed(version, 2))


def test_a_deployment_that_goes_on_writes_nothing(owner: Owner, yard: Yard) -> None:
    version = yard.publish(GOOD)
    owner.signed(version, 1)
    before = owner.metadata()

    owner.signed(version, 2, deployment="dep-1")

    assert owner.metadata() == before


@pytest.mark.parametrize("role", ROLES)
def test_a_deployment_renews_what_is_in_the_second_half_of_its_time(role: Role, owner: Owner, yard: Yard) -> None:
    version = yard.publish(GOOD)
    owner.signed(version, 1)
    owner.clock.days = LIFETIMES[role].days / 2 + 1

    owner.signed(version, 2)

    with open_repository(owner.store, owner.ring, clock=owner.clock) as session:
        assert not any(session.due(each) for each in ROLES)


def test_a_deployment_with_expired_targets_asks_for_their_key(owner: Owner, yard: Yard) -> None:
    version = yard.publish(GOOD)
    _hide(owner, "root", "targets")
    owner.clock.days = 200
    assert owner.renew() == ["targets"]
    owner.clock.days = 400

    with pytest.raises(TrustRefused, match="targets expired; bring their keys"):
        owner.admit(version)


def test_a_bundle_that_is_not_what_was_published_is_not_signed_for(owner: Owner, yard: Yard) -> None:
    version = yard.publish(GOOD)
    owner.store.put(f"bundles/{version.digest}", b"evil")

    with pytest.raises(TrustRefused, match="was changed; publish the application again"):
        owner.admit(version)


def test_metadata_that_went_back_is_not_built_upon(owner: Owner) -> None:
    before = owner.metadata()
    owner.renew()
    owner.restore(before)

    with pytest.raises(TrustRefused, match="went back to version 1, after 2; find out who writes"):
        owner.renew()


def test_metadata_of_others_is_not_built_upon(owner: Owner, tmp_path: Path) -> None:
    thief = Owner(owner.store, tmp_path / "thief")
    for key, body in thief.metadata().items():
        owner.store.put(key.replace(thief.repository, owner.repository), body)

    with pytest.raises(TrustRefused, match="not what was signed"):
        owner.renew()


def test_metadata_that_is_gone_is_not_made_anew_in_silence(owner: Owner) -> None:
    for key in owner.metadata():
        owner.store.delete(key)

    with pytest.raises(TrustRefused, match="restore it from a backup"):
        owner.renew()
    with pytest.raises(TrustRefused, match="restore it from a backup"):
        init_keys(owner.store, owner.folder)


def test_two_sets_of_keys_do_not_disturb_each_other(owner: Owner, yard: Yard, tmp_path: Path) -> None:
    other = Owner(owner.store, tmp_path / "others")
    version = yard.publish(GOOD)

    for each in (owner, other, owner):
        each.renew()
        each.verifier(tmp_path / each.repository)(each.signed(version, 1))


@pytest.mark.long
@settings(max_examples=25)
@given(operations=_OPERATIONS, looks=st.integers(0, 63), back=st.integers(0, 5))
def test_whatever_the_owner_does_robots_follow_and_never_go_back(
    operations: list[Role], looks: int, back: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("property")
    store: Store = open_store((folder / "store").as_uri())
    owner, yard = Owner(store, folder / "keys"), Yard(store, folder)
    version = yard.publish(GOOD)
    verify, first_root = owner.verifier(folder / "robot"), owner.root
    history = [owner.metadata()]
    for number, operation in enumerate(operations):
        _do(owner, yard, operation)
        history.append(owner.metadata())
        if looks >> number & 1:
            verify(owner.signed(version, 1, deployment=f"look-{number}"))
            history.append(owner.metadata())
    last = owner.signed(version, 1, deployment="last")
    verify(last)
    owner.verifier(folder / "new robot", first_root)(last)

    old = history[back % len(history)]
    same = old[owner.key("timestamp.json")] == owner.metadata()[owner.key("timestamp.json")]
    owner.restore(old)
    if same:
        verify(last)
    else:
        with pytest.raises(TrustRefused):
            verify(last)


def _do(owner: Owner, yard: Yard, operation: str) -> None:
    if operation == "renew":
        owner.renew()
    elif operation == "admit":
        owner.admit(yard.publish({"run.sh": f"{len(owner.metadata())}"}), f"dep-{len(owner.metadata())}")
    else:
        owner.rotate(next(role for role in ROLES if role == operation))


def test_a_signer_needs_no_bundle_to_sign(owner: Owner, yard: Yard) -> None:
    assert owner.signer.sign(desired(yard.publish(GOOD), 1)).signature
