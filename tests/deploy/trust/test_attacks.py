"""What somebody tries who can write to the store, with none of the keys or a stolen one: the robot runs what it ran."""

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from specs.errors import TrustRefused
from specs.robomaker.bundle import Version
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.fleet_registry import read_desired
from tasks.deploy.fleet.states import Desired
from tasks.storage.base.keys import bundle_key, desired_key
from tasks.storage.base.store import encode_document
from tests.deploy.one_robot import GOOD, NAME, desired
from tests.deploy.trust.signed_fleet import NEWER, OLDER, CarefulRobot, Owner, asked, refused
from tests.deploy.yard import Yard

CHANGES: dict[str, dict[str, object]] = {
    "another bundle": {"digest": "0" * 64},
    "another launch": {"launch": DeploymentLaunchConfig(packageName="courier", launchFile="evil.sh")},
    "a variable": {"environment": {"MAX_SPEED": "100"}},
    "a higher sequence": {"sequence": 99},
    "a later expiry": {"expires_at_s": 9e9},
    "a condition": {"condition": {"bucket": "evil", "key": "script"}},
    "a longer timeout": {"timeout_s": 604_800.0},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_desired_state_that_was_changed_is_refused(
    change: dict[str, object], yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = asked(owner, yard.publish(NEWER), "next")
    yard.store.put(desired_key(NAME), encode_document(Desired.model_validate({**wanted.model_dump(), **change})))

    refused(careful, installed, careful.look(), "it ")


def test_a_desired_state_without_a_signature_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = asked(owner, yard.publish(NEWER), "next")
    yard.store.put(desired_key(NAME), encode_document(wanted.model_copy(update={"signature": None})))

    refused(careful, installed, careful.look(), "not signed; deploy with the keys")


def test_a_desired_state_of_an_unsigned_deployment_is_refused(
    yard: Yard, careful: CarefulRobot, installed: Version
) -> None:
    refused(careful, installed, careful.look(desired(yard.publish(NEWER), 2)), "not signed")


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

    refused(careful, installed, careful.look(old.model_copy(update={"sequence": 2})), "it was changed after")


def test_what_another_robot_is_asked_is_not_for_this_one(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    others = owner.signed(yard.publish(NEWER), 2, robot="r2")

    careful.look(others)
    assert careful.runs == (installed.digest, 1)
    refused(careful, installed, careful.look(others.model_copy(update={"robot": NAME})), "it was changed after")


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

    wanted = signer.sign(desired(older, 2, deployment="good"))
    refused(careful, installed, careful.look(wanted), "not on the deployer's signed list")


def test_a_condition_that_was_changed_after_the_signature_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    etag = yard.store.put("buckets/mine/condition.sh", b"#!/bin/sh\nexit 0\n")
    condition = {"bucket": "mine", "key": "condition.sh", "etag": etag}
    newer = yard.publish(NEWER)
    wanted = owner.signed(newer, 2, condition=condition)
    yard.store.put("buckets/mine/condition.sh", b"#!/bin/sh\ntouch $HOME/evil\n")

    reported = careful.look(wanted)

    assert (reported.failure_code, reported.step) == ("EtagMismatch", "ExecutingDownloadCondition")
    assert not (careful.folder / "evil").exists()
    assert careful.runs == (installed.digest, 1)


@pytest.mark.parametrize("named", [None, "0" * 32])
def test_a_condition_that_the_document_does_not_name_by_its_content_is_not_signed(
    yard: Yard, owner: Owner, named: str | None
) -> None:
    etag = yard.store.put("buckets/mine/condition.sh", b"#!/bin/sh\ntouch $HOME/evil\n")
    condition = {"bucket": "mine", "key": "condition.sh", "etag": named}

    with pytest.raises(TrustRefused, match=f"downloadConditionFile.etag.*{etag}"):
        owner.signed(yard.publish(NEWER), 2, condition=condition)


def test_a_desired_state_that_expired_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    owner.admit(newer)
    owner.clock.days = -31
    wanted = owner.signer.sign(desired(newer, 2))

    refused(careful, installed, careful.look(wanted), "deploy again")


def test_other_keys_are_not_these_keys(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, tmp_path: Path
) -> None:
    thief = Owner(yard.store, tmp_path / "others")
    newer = yard.publish(NEWER)
    owner.admit(newer)

    refused(careful, installed, careful.look(thief.signed(newer, 2)), "deploy again with the keys that this robot")


def test_a_stolen_deployers_key_is_worth_nothing_once_it_was_replaced(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    stolen = owner.signer
    owner.admit(newer)
    evil = stolen.sign(desired(newer, 2))
    list_of_the_thief = owner.metadata()

    owner.rotate("deployer", "snapshot", "timestamp")

    refused(careful, installed, careful.look(evil), "not the deployer's key any more")
    owner.restore({key: body for key, body in list_of_the_thief.items() if "timestamp" in key})
    refused(careful, installed, careful.look(evil), "find out who writes to the store")


def test_what_a_thief_put_on_the_list_is_gone_with_the_stolen_key(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    evil = yard.publish(NEWER)
    owner.admit(evil)

    owner.rotate("deployer")

    wanted = owner.signer.sign(desired(evil, 2))
    refused(careful, installed, careful.look(wanted), "in no fleet that a key vouches for")


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

    assert careful.look(asked(owner, older, "third", issued_at_s=time.time())).status == "InSync"
    assert careful.runs == (older.digest, 1)


def test_the_metadata_of_yesterday_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    yesterday = owner.metadata()
    newer = yard.publish(NEWER)
    wanted = owner.signed(newer, 2)
    careful.check(wanted)
    owner.restore(yesterday)

    refused(careful, installed, careful.look(wanted), "older than what this robot has seen: find out who writes")


@pytest.mark.parametrize("role", ["snapshot", "targets", "deployer"])
def test_old_metadata_under_a_new_name_is_refused(
    role: str, yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    if role == "targets":
        owner.rotate("deployer")
        wanted = owner.signed(yard.publish(NEWER), 2)
    yard.store.put(owner.latest(role), yard.store.get(owner.latest(role, back=1)).body)

    refused(careful, installed, careful.look(wanted), "find out who writes to the store")


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

    refused(careful, installed, careful.look(wanted), "find out who writes to the store")


def test_metadata_that_is_gone_is_refused(yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    yard.store.delete(owner.key("timestamp.json"))

    refused(careful, installed, careful.look(wanted), "restore trust/ from a backup")


def test_a_store_that_is_frozen_in_the_past_is_refused(yard: Yard, tmp_path: Path) -> None:
    owner = Owner(yard.store, tmp_path / "keys")
    owner.clock.days = -0.9
    owner.renew()
    version = yard.publish(GOOD)
    careful = CarefulRobot(yard, owner.root)
    try:
        assert careful.look(owner.signed(version, 1)).status == "InSync"
        wanted = owner.signed(yard.publish(NEWER), 2)
        owner.clock.days = -1.1
        owner.renew()

        reported = careful.look(wanted)

        refused(careful, version, reported, "run simyard fleet keys renew")
        owner.clock.days = 0
        owner.renew()
        assert careful.look(wanted).status == "InSync", "what was refused is taken once the metadata is fresh"
    finally:
        careful.robot.end()


def test_metadata_signed_by_other_keys_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, tmp_path: Path
) -> None:
    thief = Owner(yard.store, tmp_path / "others")
    wanted = thief.signed(yard.publish(NEWER), 2)
    for key, body in thief.metadata().items():
        yard.store.put(key.replace(thief.repository, owner.repository), body)

    refused(careful, installed, careful.look(wanted), "signed by keys that this robot does not trust")


def test_a_root_that_the_old_root_has_not_signed_is_refused(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, tmp_path: Path
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    thief = Owner(yard.store, tmp_path / "others")
    thief.rotate("root")
    yard.store.put(owner.key("2.root.json"), yard.store.get(thief.key("2.root.json")).body)

    refused(careful, installed, careful.look(wanted), "signed by keys that this robot does not trust")
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
