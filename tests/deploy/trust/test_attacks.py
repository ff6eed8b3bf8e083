"""What somebody tries who can write to the store, with none of the keys or a stolen one: the robot runs what it ran."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from specs.bundle import Version
from specs.deployment import DeploymentLaunchConfig
from specs.errors import StoreAccessDenied, StoreError, StoreUnreachable, TrustRefused
from tasks.deploy.robots import read_desired
from tasks.deploy.states import Desired, Reported
from tasks.deploy.trust.repository import init_keys
from tasks.deploy.trust.signing import DeploymentSigner
from tasks.deploy.trust.verifying import Verifier
from tasks.storage.encoding import encoded
from tasks.storage.keys import bundle_key, desired_key
from tasks.storage.store import Store, Stored
from tests.deploy.one_robot import GOOD, NAME, desired
from tests.deploy.trust.trusting import NEWER, OLDER, CarefulRobot, Owner, asked
from tests.deploy.yard import Yard


@pytest.fixture
def installed(yard: Yard, owner: Owner, careful: CarefulRobot) -> Version:
    """What the robot runs before the attack."""
    version = yard.publish(GOOD)
    assert careful.look(asked(owner, version, "good")).status == "InSync"
    return version


def _refused(careful: CarefulRobot, installed: Version, reported: Reported, says: str) -> None:
    assert (reported.status, reported.failure_code) == ("Failed", "BadPermissionError")
    assert says in reported.failure_reason
    assert reported.running_digest == installed.digest
    assert careful.runs == (installed.digest, 1)
    assert careful.disk.load().sequence == 1, "what is refused must not count as seen"


CHANGES: dict[str, dict[str, object]] = {
    "another bundle": {"digest": "0" * 64},
    "another launch": {"launch": DeploymentLaunchConfig(packageName="courier", launchFile="evil.sh")},
    "a variable": {"environment": {"MAX_SPEED": "100"}},
    "a higher sequence": {"sequence": 99},
    "a later expiry": {"expires_at_s": 9e9},
    "a condition": {"condition": {"bucket": "evil", "key": "script"}},
    "no timeout": {"timeout_s": float("inf")},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_desired_state_that_was_changed_is_refused(
    change: dict[str, object], yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = asked(owner, yard.publish(NEWER), "next")
    yard.store.put(desired_key(NAME), encoded(Desired.model_validate({**wanted.model_dump(), **change})))

    _refused(careful, installed, careful.look(), "it ")


def test_a_desired_state_without_a_signature_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = asked(owner, yard.publish(NEWER), "next")
    yard.store.put(desired_key(NAME), encoded(wanted.model_copy(update={"signature": None})))

    _refused(careful, installed, careful.look(), "not signed; deploy with the keys")


def test_a_desired_state_of_an_unsigned_deployment_is_refused(
    yard: Yard, careful: CarefulRobot, installed: Version
) -> None:
    _refused(careful, installed, careful.look(desired(yard.publish(NEWER), 2)), "not signed")


def test_an_old_desired_state_does_not_come_back(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    old = yard.store.get(desired_key(NAME)).body
    newer = yard.publish(NEWER)
    assert careful.look(asked(owner, newer, "next")).status == "InSync"
    yard.store.put(desired_key(NAME), old)

    careful.look()

    assert careful.runs == (newer.digest, 1)


def test_an_old_sequence_with_a_new_number_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    old, _ = read_desired(yard.store, NAME)
    assert old is not None

    _refused(careful, installed, careful.look(old.model_copy(update={"sequence": 2})), "it was changed after")


def test_what_another_robot_is_asked_is_not_for_this_one(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    others = owner.signed(yard.publish(NEWER), 2, robot="r2")

    careful.look(others)
    assert careful.runs == (installed.digest, 1)
    _refused(careful, installed, careful.look(others.model_copy(update={"robot": NAME})), "it was changed after")


def test_a_bundle_that_was_changed_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    wanted = asked(owner, newer, "next")
    body = yard.store.get(bundle_key(newer.digest)).body
    yard.store.put(bundle_key(newer.digest), body.replace(b"sleep", b"steal"))

    reported = careful.look(wanted)

    assert (reported.status, reported.failure_code) == ("Failed", "EtagMismatch")
    assert careful.runs == (installed.digest, 1)


def test_a_bundle_that_is_not_on_the_signed_list_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    older = yard.publish(OLDER)
    signer = owner.signer

    _refused(careful, installed, careful.look(signer.sign(desired(older, 2))), "not on the deployer's signed list")


def test_a_condition_that_was_changed_after_the_signature_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    condition = {"bucket": "mine", "key": "condition.sh"}
    yard.store.put("buckets/mine/condition.sh", b"#!/bin/sh\nexit 0\n")
    newer = yard.publish(NEWER)
    wanted = owner.signed(newer, 2, condition=condition)
    yard.store.put("buckets/mine/condition.sh", b"#!/bin/sh\ntouch $HOME/evil\n")

    reported = careful.look(wanted)

    assert (reported.failure_code, reported.step) == ("EtagMismatch", "ExecutingDownloadCondition")
    assert not (careful.folder / "evil").exists()
    assert careful.runs == (installed.digest, 1)


def test_the_metadata_of_yesterday_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    yesterday = owner.metadata()
    newer = yard.publish(NEWER)
    wanted = owner.signed(newer, 2)
    careful.check(wanted)
    owner.restore(yesterday)

    _refused(careful, installed, careful.look(wanted), "older than what this robot has seen: find out who writes")


@pytest.mark.parametrize("role", ["snapshot", "targets", "deployer"])
def test_old_metadata_under_a_new_name_is_refused(
    role: str, yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    if role == "targets":
        owner.rotate("deployer")
        wanted = owner.signed(yard.publish(NEWER), 2)
    yard.store.put(owner.latest(role), yard.store.get(owner.latest(role, back=1)).body)

    _refused(careful, installed, careful.look(wanted), "find out who writes to the store")


SPOILS: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda body: body[: len(body) // 2],
    "empty": lambda _: b"",
    "edited": lambda body: body.replace(b'"version": ', b'"version": 1'),
}


@pytest.mark.parametrize("role", ["timestamp", "snapshot", "deployer"])
@pytest.mark.parametrize("spoil", SPOILS.values(), ids=SPOILS)
def test_spoiled_metadata_is_refused(
    yard: Yard,
    owner: Owner,
    careful: CarefulRobot,
    installed: Version,
    *,
    role: str,
    spoil: Callable[[bytes], bytes],
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    key = owner.latest(role)
    body = json.dumps(json.loads(yard.store.get(key).body)).encode()
    assert spoil(body) != body
    yard.store.put(key, spoil(body))

    _refused(careful, installed, careful.look(wanted), "find out who writes to the store")


def test_metadata_that_is_gone_is_refused(yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    yard.store.delete(owner.key("timestamp.json"))

    _refused(careful, installed, careful.look(wanted), "restore trust/ from a backup")


def test_a_store_that_is_frozen_in_the_past_is_refused(yard: Yard, tmp_path: Path) -> None:
    owner = Owner(yard.store, tmp_path / "keys")
    owner.clock.days = -6.9
    owner.renew()
    version = yard.publish(GOOD)
    careful = CarefulRobot(yard, owner.root)
    try:
        assert careful.look(owner.signed(version, 1)).status == "InSync"
        wanted = owner.signed(yard.publish(NEWER), 2)
        owner.clock.days = -8
        owner.renew()

        reported = careful.look(wanted)

        _refused(careful, version, reported, "run simyard fleet keys renew")
        owner.clock.days = 0
        owner.renew()
        assert careful.look(wanted).status == "InSync", "what was refused is taken once the metadata is fresh"
    finally:
        careful.robot.end()


def test_a_desired_state_that_expired_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    owner.signer.admit(newer.digest)
    owner.clock.days = -31
    wanted = owner.signer.sign(desired(newer, 2))

    _refused(careful, installed, careful.look(wanted), "deploy again")


def test_other_keys_are_not_these_keys(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, tmp_path: Path
) -> None:
    thief = Owner(yard.store, tmp_path / "others")
    newer = yard.publish(NEWER)
    owner.signer.admit(newer.digest)

    _refused(careful, installed, careful.look(thief.signed(newer, 2)), "deploy again with the keys that this robot")


def test_metadata_signed_by_other_keys_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, tmp_path: Path
) -> None:
    thief = Owner(yard.store, tmp_path / "others")
    wanted = thief.signed(yard.publish(NEWER), 2)
    for key, body in thief.metadata().items():
        yard.store.put(key.replace(thief.repository, owner.repository), body)

    _refused(careful, installed, careful.look(wanted), "signed by keys that this robot does not trust")


def test_a_stolen_deployers_key_is_worth_nothing_once_it_was_replaced(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    stolen = owner.signer
    stolen.admit(newer.digest)
    evil = stolen.sign(desired(newer, 2))
    list_of_the_thief = owner.metadata()

    owner.rotate("deployer", "snapshot", "timestamp")

    _refused(careful, installed, careful.look(evil), "not the deployer's key any more")
    owner.restore({key: body for key, body in list_of_the_thief.items() if "timestamp" in key})
    _refused(careful, installed, careful.look(evil), "find out who writes to the store")


def test_what_a_thief_put_on_the_list_is_gone_with_the_stolen_key(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    evil = yard.publish(NEWER)
    owner.signer.admit(evil.digest)

    owner.rotate("deployer")

    wanted = owner.signer.sign(desired(evil, 2))
    _refused(careful, installed, careful.look(wanted), "not on the deployer's signed list")


def test_a_root_that_the_old_root_has_not_signed_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, tmp_path: Path
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    thief = Owner(yard.store, tmp_path / "others")
    thief.rotate("root")
    yard.store.put(owner.key("2.root.json"), yard.store.get(thief.key("2.root.json")).body)

    _refused(careful, installed, careful.look(wanted), "signed by keys that this robot does not trust")
    with pytest.raises(TrustRefused, match=r"2\.root\.json is not what was signed.*restore it from a backup"):
        owner.renew()


def test_a_robot_that_slept_through_every_rotation_wakes_up_to_the_new_keys(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    for _ in range(2):
        owner.rotate("root", "targets", "snapshot", "timestamp", "deployer")
    newer = yard.publish(NEWER)

    assert careful.look(owner.signed(newer, 2)).status == "InSync"
    assert careful.runs == (newer.digest, 1)


def test_what_the_robot_runs_goes_on_after_everything_expired(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    owner.clock.days = -800
    owner.renew()
    careful.look(owner.signed(yard.publish(NEWER), 2))
    careful.robot.end()

    again = CarefulRobot(yard, owner.root)
    again.robot.recover()
    try:
        assert again.runs == (installed.digest, 1)
    finally:
        again.robot.end()


@pytest.mark.parametrize("attack", ["delete", "put back"])
def test_a_desired_state_that_is_taken_away_does_not_make_the_robot_deaf(
    attack: str, yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    first = yard.store.get(desired_key(NAME)).body
    newer, older = yard.publish(NEWER), yard.publish(OLDER)
    assert careful.look(asked(owner, newer, "next")).status == "InSync"
    yard.store.delete(desired_key(NAME))
    if attack == "put back":
        yard.store.put(desired_key(NAME), first)

    assert careful.look(asked(owner, older, "third")).status == "InSync"
    assert careful.runs == (older.digest, 1)


class _StrictStore:
    """A store that answers 403 for what is not there, as S3 does to who may not list, or that is away."""

    def __init__(self, store: Store, error: type[StoreError], names: str) -> None:
        self.url = store.url
        self._store = store
        self._error = error
        self._names = names

    def get(self, key: str) -> Stored:
        if self._names in key:
            raise self._error("no")
        return self._store.get(key)


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
