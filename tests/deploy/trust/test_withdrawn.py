"""What was withdrawn stays withdrawn: for robots that have seen it at once, for all others within a day."""

import pytest

from specs.errors import TrustRefused
from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import create_robot, read_reported, register_robot
from tasks.deploy.rollout.deployment_job import run_deployment_job, run_sync_job
from tasks.deploy.rollout.operator_commands import steer, withdraw_canceled
from tasks.deploy.trust.repository import open_repository, renew_metadata, restore_metadata
from tasks.storage.base.keys import fleet_key, robot_record_key
from tasks.storage.jobs.records import JobRecord, job_id
from tests.deploy.one_robot import GOOD, NAME, desired
from tests.deploy.puppets import PuppetRobots
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner, asked, refused
from tests.deploy.yard import FLEET, Yard


def _deploy(yard: Yard, owner: Owner, robots: PuppetRobots, version: Version, token: str) -> JobRecord:
    return run_deployment_job(
        yard.store,
        yard.request(version, token),
        digest=version.digest,
        token=token,
        progress=lambda *_: None,
        pace=robots.pace,
        signer=owner.signer,
    )


def _sync(yard: Yard, owner: Owner, robots: PuppetRobots) -> JobRecord:
    token = "sync"  # noqa: S105 - of a client request
    return run_sync_job(yard.store, FLEET, token=token, progress=lambda *_: None, pace=robots.pace, signer=owner.signer)


@pytest.fixture
def robots(yard: Yard, owner: Owner) -> PuppetRobots:
    robots = PuppetRobots(yard.store, 2)
    owner.vouch(*robots.names)
    return robots


def test_what_was_withdrawn_is_refused_by_a_robot_that_never_saw_it(yard: Yard, owner: Owner) -> None:
    wanted = owner.signed(yard.publish(GOOD), 1)
    owner.signer.withdraw(wanted.deployment)
    robot = CarefulRobot(yard, owner.root)

    assert "not in force" in robot.look(wanted).failure_reason
    assert robot.runs == ("", 0)


def test_what_was_withdrawn_is_refused_with_old_metadata_by_a_robot_that_saw_newer(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    before = owner.metadata()
    owner.signer.withdraw(wanted.deployment)
    refused(careful, installed, careful.look(wanted), "'dep-2' is not in force in 'couriers'")
    owner.restore(before)

    refused(careful, installed, careful.look(wanted), "older than what this robot has seen")


def test_what_was_withdrawn_is_refused_with_old_metadata_when_the_timestamp_has_expired(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    owner.clock.days = -1.01
    wanted = owner.signed(yard.publish(NEWER), 2)
    before = owner.metadata()
    owner.signer.withdraw(wanted.deployment)
    owner.restore(before)

    refused(careful, installed, careful.look(wanted), "signed metadata expired")


def test_the_window_of_a_withdrawal_is_that_of_the_longest_timestamp_before_it(yard: Yard, owner: Owner) -> None:
    with open_repository(yard.store, owner.ring) as session:
        session.choose_lifetime(24 * 7)
        renew_metadata(session)
    wanted = owner.signed(yard.publish(GOOD), 1)
    with open_repository(yard.store, owner.ring) as session:
        session.choose_lifetime(24)
        renew_metadata(session)

    ends_s = owner.signer.withdraw(wanted.deployment)

    assert ends_s is not None
    assert ends_s > owner.clock().timestamp() + 6 * 86_400


def test_a_timestamp_alone_is_signed_anew_once_less_than_half_of_its_day_is_left(owner: Owner) -> None:
    before = owner.metadata()
    owner.signer.renew()
    assert owner.metadata() == before
    owner.clock.days = 0.6
    owner.signer.renew()

    after = owner.metadata()
    assert {key for key in after if after[key] != before.get(key)} == {owner.key("timestamp.json")}


def test_a_signer_that_signs_for_long_looks_again_in_time(owner: Owner) -> None:
    signer, version = owner.signer, owner.latest("timestamp")
    signer.renew()
    before = owner.store.get(version).body
    owner.clock.days = 0.4
    signer.renew()
    assert owner.store.get(version).body == before
    owner.clock.days = 0.6
    signer.renew()
    assert owner.store.get(version).body != before


@pytest.mark.long
def test_a_canceled_deployment_is_not_in_force(yard: Yard, owner: Owner, robots: PuppetRobots) -> None:
    robots.silent = {*robots.names}

    def cancel(_seconds: float) -> None:
        steer(yard.store, job_id("deployment-job", "one"), "cancel")
        robots.pace_sleep = None

    robots.pace_sleep = cancel
    record = _deploy(yard, owner, robots, yard.publish(GOOD), "one")

    assert record.status == "Canceled"
    assert owner.signer.fleets().known(FLEET).deployments == []
    with pytest.raises(TrustRefused, match="is not in force in 'couriers': it was canceled"):
        _sync(yard, owner, robots)


def test_what_was_canceled_without_keys_is_withdrawn_by_who_renews(yard: Yard, owner: Owner) -> None:
    robots = PuppetRobots(yard.store, 1)
    owner.vouch("r0")
    robots.dies_after = 0
    with pytest.raises(Exception, match="killed"):
        _deploy(yard, owner, robots, yard.publish(GOOD), "one")
    job = job_id("deployment-job", "one")
    assert steer(yard.store, job, "cancel").status == "Canceled"
    assert owner.signer.fleets().fleet_of(job) == FLEET

    assert withdraw_canceled(yard.store, owner.signer, [job, "dep-forgotten"]) == (job,)

    assert owner.signer.fleets().fleet_of(job) is None


def test_a_withdrawn_deployment_is_not_continued(yard: Yard, owner: Owner, robots: PuppetRobots) -> None:
    robots.dies_after = 0
    version = yard.publish(GOOD)
    with pytest.raises(Exception, match="killed"):
        _deploy(yard, owner, robots, version, "one")
    owner.signer.withdraw(job_id("deployment-job", "one"))

    with pytest.raises(TrustRefused, match="make a new deployment"):
        _deploy(yard, owner, robots, version, "one")


def test_a_deployment_that_died_before_its_record_had_a_plan_begins_again(
    yard: Yard, owner: Owner, robots: PuppetRobots
) -> None:
    version, job = yard.publish(GOOD), job_id("deployment-job", "one")
    owner.signer.sign_fleets(lambda fleets: fleets.begun(FLEET, job, [version.digest]))

    assert _deploy(yard, owner, robots, version, "one").status == "Succeeded"
    assert owner.signer.fleets().known(FLEET).deployments == [job]


def test_a_deployment_supersedes_the_last_one_and_its_syncs(yard: Yard, owner: Owner, robots: PuppetRobots) -> None:
    first = _deploy(yard, owner, robots, yard.publish(GOOD), "one")
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")
    robots.names.append("late")
    owner.vouch("late")
    synced = _sync(yard, owner, robots)
    assert owner.signer.fleets().known(FLEET).deployments == [first.id, synced.id]

    second = _deploy(yard, owner, robots, yard.publish(NEWER), "two")

    known = owner.signer.fleets().known(FLEET)
    assert known.deployments == [second.id]
    assert [each.deployment for each in known.withdrawn] == [first.id, synced.id]


def test_a_robot_whose_record_was_edited_stops_the_deployment_before_anybody_is_asked(
    yard: Yard, owner: Owner, robots: PuppetRobots
) -> None:
    create_robot(yard.store, "moved")
    key = robot_record_key("moved")
    yard.store.put(key, yard.store.get(key).body.replace(b'"fleet":""', b'"fleet":"couriers"'))

    with pytest.raises(TrustRefused, match=r"no key vouches that 'moved' belong.*simyard fleet vouch couriers"):
        _deploy(yard, owner, robots, yard.publish(GOOD), "one")

    assert robots.asked() == []


def test_a_plan_of_another_fleet_is_not_synced_unsigned_either(yard: Yard, robots: PuppetRobots) -> None:
    version = yard.publish(GOOD)
    run_deployment_job(
        yard.store,
        yard.request(version, "one"),
        digest=version.digest,
        token="one",  # noqa: S106 - a client request token
        progress=lambda *_: None,
        pace=robots.pace,
    )
    body = yard.store.get(fleet_key(FLEET)).body
    yard.store.put(fleet_key("keepers"), body.replace(b'"name":"couriers"', b'"name":"keepers"'))

    with pytest.raises(TrustRefused, match="the last deployment of 'keepers' by the store's records, is 'couriers''s"):
        run_sync_job(yard.store, "keepers", token="sync", progress=lambda *_: None)  # noqa: S106


def test_metadata_that_says_nothing_of_force_is_refused(yard: Yard, owner: Owner) -> None:
    wanted = owner.signed(yard.publish(GOOD), 1)
    with open_repository(yard.store, owner.ring) as session:
        session.state.deployer.signed.unrecognized_fields.clear()
        session.commit(["deployer"])

    assert "in no fleet that a key vouches for" in CarefulRobot(yard, owner.root).look(wanted).failure_reason


def test_the_owner_writes_back_what_was_replaced_or_lost(yard: Yard, owner: Owner) -> None:
    before = owner.metadata()
    wanted = owner.signed(yard.publish(GOOD), 1)
    newest = owner.metadata()
    owner.restore(before)
    with pytest.raises(TrustRefused, match=r"went back to version 1, after 2.*simyard fleet keys restore"):
        owner.renew()

    assert restore_metadata(yard.store, owner.ring) == 2
    assert owner.metadata() == newest
    for key in newest:
        yard.store.delete(key)
    restore_metadata(yard.store, owner.ring)
    owner.renew()
    owner.verifier(yard.folder / "robot")(wanted)


def test_what_is_asked_of_a_robot_is_in_force_for_it(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    newer = yard.publish(NEWER)
    assert careful.look(asked(owner, newer, "next")).status == "InSync"
    owner.signer.sign_fleets(lambda fleets: fleets.enlisted("keepers", [NAME]))

    reported = careful.look(owner.signer.sign(desired(newer, 3, deployment="next")))

    assert "'next' is not in force in 'keepers'" in reported.failure_reason
    assert careful.runs == (newer.digest, 1), "what runs goes on"


def test_a_robot_that_had_begun_and_was_off_gives_up_what_was_withdrawn_meanwhile(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    wanted = owner.signed(yard.publish(NEWER), 2)
    state = careful.disk.load()
    careful.disk.save(state.model_copy(update={"target": wanted, "sequence": 2}))  # as if the power failed then
    careful.robot.end()
    owner.signer.withdraw(wanted.deployment)

    again = CarefulRobot(yard, owner.root)
    again.robot.recover()
    try:
        assert again.runs == (installed.digest, 1)
        reported = read_reported(yard.store, NAME)
        assert reported is not None
        assert (reported.status, reported.failure_code) == ("Failed", "BadPermissionError")
        assert again.disk.load().target is None
    finally:
        again.robot.end()
