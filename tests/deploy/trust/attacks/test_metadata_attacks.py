"""What somebody tries with the signed metadata itself: the robot runs what it ran."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from specs.errors import TrustRefused
from specs.robomaker.bundle import Version
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner, refused
from tests.deploy.yard import Yard

pytestmark = pytest.mark.long


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
