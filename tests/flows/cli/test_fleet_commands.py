"""A fleet of real robots, made on the command line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from specs.arn import arn
from specs.errors import DocumentError, ResourceNotFound, TrustRefused
from tasks.deploy.fleet.fleet_registry import create_fleet, fleets, members, robots
from tasks.deploy.trust.keyring import ROOT_FILE
from tasks.deploy.trust.repository import init_keys
from tasks.deploy.trust.signed_fleets import SignedFleets
from tasks.deploy.trust.signer import open_signer
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store, store_id
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def _simyard(store: Store, *arguments: str) -> Result:
    return CliRunner().invoke(app, ["fleet", *arguments, "--store", store.url], catch_exceptions=False)


def test_a_fleet_is_made_once_and_its_arn_is_told(file_store: Store) -> None:
    told = {_simyard(file_store, "create", "couriers").output for _ in range(2)}

    assert told == {arn("deployment-fleet", store_id(file_store), "couriers") + "\n"}
    assert [fleet.name for fleet in fleets(file_store)] == ["couriers"]


def test_a_registered_robot_is_made_and_is_no_demonstrations_robot(file_store: Store) -> None:
    create_fleet(file_store, "couriers")

    told = _simyard(file_store, "register", "couriers", "r1").output

    assert told == arn("robot", store_id(file_store), "r1") + "\n"
    assert [(robot.name, robot.local) for robot in members(file_store, "couriers")] == [("r1", False)]


def test_a_robot_of_another_fleet_is_not_taken_from_it(file_store: Store) -> None:
    for fleet in ("couriers", "cleaners"):
        create_fleet(file_store, fleet)
    _simyard(file_store, "register", "couriers", "r1")

    with pytest.raises(DocumentError, match="it is in couriers"):
        _simyard(file_store, "register", "cleaners", "r1")

    assert [robot.name for robot in members(file_store, "couriers")] == ["r1"]


def test_a_robot_is_not_made_for_a_fleet_that_does_not_exist(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        _simyard(file_store, "register", "nobody", "r1")

    assert robots(file_store) == []


def test_a_fleet_is_shown_with_its_robots(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2"):
        _simyard(file_store, "register", "couriers", robot)

    shown = json.loads(_simyard(file_store, "show", arn("deployment-fleet", store_id(file_store), "couriers")).stdout)

    assert shown["name"] == "couriers"
    assert [(robot["name"], robot["status"]) for robot in shown["robots"]] == [
        ("r1", "Registered"),
        ("r2", "Registered"),
    ]


def test_nothing_is_paused_where_nothing_is_under_way(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for command in ("pause", "resume"):
        told = _simyard(file_store, command, "couriers")
        assert (told.exit_code, told.stderr) == (2, "no deployment of couriers is under way\n")
        with pytest.raises(ResourceNotFound):
            _simyard(file_store, command, "nobody")


def test_a_fleet_to_which_nothing_was_deployed_has_nothing_to_watch_or_sync(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    assert "nothing was deployed" in _simyard(file_store, "watch", "couriers").output
    with pytest.raises(ResourceNotFound, match="something was deployed"):
        _simyard(file_store, "sync", "couriers", "--unsigned")


def test_a_sync_with_nothing_to_do_is_a_deployment_that_its_token_names(file_store: Store, tmp_path: Path) -> None:
    yard = Yard(file_store, tmp_path)
    create_fleet(file_store, FLEET)
    version = yard.publish({"run.sh": STAYS_UP})
    run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)
    told = [_simyard(yard.store, "sync", FLEET, "--token", token) for token in ("mine", "mine", "other")]
    lines = [each.stdout.splitlines() for each in told]
    assert [each.exit_code for each in told] == [0, 0, 0]
    assert lines[0][0] == f"all robots of {FLEET} are in sync"
    assert lines[0][1].startswith("Succeeded arn:simyard:deployment-job:")
    assert lines[0] == lines[1] != lines[2]
    with pytest.raises(DocumentError, match="clientRequestToken"):
        _simyard(yard.store, "sync", FLEET, "--token", "a b")


def test_robots_and_fleets_leave_as_they_came(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2"):
        _simyard(file_store, "register", "couriers", robot)
    assert _simyard(file_store, "deregister", "r1").output == "r1 is in no fleet now\n"
    assert _simyard(file_store, "delete", "couriers").output == "couriers is deleted; in no fleet now: r2\n"
    assert _simyard(file_store, "delete-robot", "r2").output == "r2 is deleted\n"
    assert [robot.name for robot in robots(file_store)] == ["r1"]
    assert fleets(file_store) == []


def test_a_robot_has_the_architecture_it_was_made_with(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    _simyard(file_store, "register", "couriers", "arm", "--architecture", "ARM64")
    _simyard(file_store, "register", "couriers", "arm")
    with pytest.raises(DocumentError, match="arm, of architecture ARM64"):
        _simyard(file_store, "register", "couriers", "arm", "--architecture", "ARMHF")

    assert [robot.architecture for robot in robots(file_store)] == ["ARM64"]


def test_the_agents_help_lists_the_agents_options() -> None:
    told = CliRunner().invoke(app, ["agent", "--help"])
    assert told.exit_code == 0
    assert "--root-of-trust" in told.output


def _keys(store: Store, *arguments: str, **environment: str) -> Result:
    argv = ["fleet", "keys", *arguments, "--store", store.url]
    return CliRunner().invoke(app, argv, catch_exceptions=False, env=environment)


def _fleet(store: Store, *arguments: str, typed: str = "", **environment: str) -> Result:
    argv = ["fleet", *arguments, "--store", store.url]
    return CliRunner().invoke(app, argv, input=typed, catch_exceptions=False, env=environment)


def _vouched(store: Store, folder: Path) -> SignedFleets:
    return open_signer(store, folder).fleets()


def _shown(store: Store, folder: Path) -> dict[str, tuple[str, str]]:
    lines = [line.split() for line in _keys(store, "show", "--keys", str(folder)).output.splitlines()]
    return {role: (key, " ".join(rest)) for role, key, _, _, *rest in lines}


def test_keys_are_made_and_shown(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    told = _keys(file_store, "init", "--keys", str(folder)).output

    assert told.startswith(f"{folder / 'root.json'}: give it to each robot")
    shown = _shown(file_store, folder)
    assert sorted(shown) == ["deployer", "root", "snapshot", "targets", "timestamp"]
    assert {where for _, where in shown.values()} == {"here"}
    assert "PRIVATE" not in told


def test_keys_are_named_by_the_environment_too(file_store: Store, tmp_path: Path) -> None:
    assert _keys(file_store, "init", SIMYARD_KEYS=str(tmp_path / "keys")).exit_code == 0
    assert _keys(file_store, "renew", SIMYARD_KEYS=str(tmp_path / "keys")).output == "renewed\n"


def test_keys_are_replaced_by_role(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    before = _shown(file_store, folder)

    _keys(file_store, "rotate", "deployer", "timestamp", "--keys", str(folder))

    after = _shown(file_store, folder)
    assert {role for role in after if after[role] != before[role]} == {"deployer", "timestamp"}


def test_nothing_is_replaced_where_one_role_does_not_exist(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    before = _shown(file_store, folder)

    with pytest.raises(DocumentError, match="captain"):
        _keys(file_store, "rotate", "deployer", "captain", "--keys", str(folder))

    assert _shown(file_store, folder) == before


def test_keys_that_are_kept_elsewhere_are_shown_so(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    for path in folder.glob("root-*.pem"):
        path.unlink()

    assert _shown(file_store, folder)["root"][1] == "not here"


def test_robots_are_signed_into_and_out_of_their_fleet(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2", "r3"):
        told = _fleet(file_store, "register", "couriers", robot, SIMYARD_KEYS=str(folder))
        assert told.output == arn("robot", store_id(file_store), robot) + "\n"
    assert _vouched(file_store, folder).robots == dict.fromkeys(("r1", "r2", "r3"), "couriers")

    _fleet(file_store, "deregister", "r1", "--keys", str(folder))
    _fleet(file_store, "delete-robot", "r2", "--keys", str(folder))
    assert _vouched(file_store, folder).robots == {"r3": "couriers"}
    _fleet(file_store, "delete", "couriers", "--keys", str(folder))
    assert _vouched(file_store, folder).robots == {}


def test_robots_that_were_registered_without_keys_are_signed_for_after_a_question(
    file_store: Store, tmp_path: Path
) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2"):
        assert f"simyard fleet vouch couriers {robot}" in _fleet(file_store, "register", "couriers", robot).stderr

    assert _fleet(file_store, "vouch", "couriers", "--keys", str(folder), typed="n\n").exit_code == 1
    assert _vouched(file_store, folder).robots == {}
    told = _fleet(file_store, "vouch", "couriers", "--keys", str(folder), typed="y\n").output
    assert "+ r1\n+ r2\n" in told
    assert "2 robots of couriers are vouched for" in told
    assert "still vouch" in _fleet(file_store, "deregister", "r2").stderr
    assert "- r2" in _fleet(file_store, "vouch", "couriers", "--keys", str(folder), "--yes").output
    assert _vouched(file_store, folder).robots == {"r1": "couriers"}


def test_a_robot_that_is_named_is_signed_for_alone_and_must_be_in_the_fleet(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2"):
        _fleet(file_store, "register", "couriers", robot)

    _fleet(file_store, "vouch", "couriers", "r2", "--keys", str(folder))

    assert _vouched(file_store, folder).robots == {"r2": "couriers"}
    with pytest.raises(DocumentError, match="a robot of couriers"):
        _fleet(file_store, "vouch", "couriers", "r3", "--keys", str(folder))


def test_what_is_in_force_and_what_may_still_be_accepted_is_shown(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    signer = open_signer(file_store, folder)
    signer.sign_fleets(lambda fleets: fleets.enlisted("couriers", ["r1"]).begun("couriers", "dep-1", ["a" * 64]))
    assert "couriers: 1 robots; in force: dep-1\n" in _keys(file_store, "show", "--keys", str(folder)).output
    signer.withdraw("dep-1")

    shown = _keys(file_store, "show", "--keys", str(folder)).output

    assert "couriers: 1 robots; in force: nothing\n" in shown
    assert "couriers: dep-1 is withdrawn; a robot that has seen nothing newer may accept it" in shown


def test_timestamps_are_signed_for_as_long_as_one_says(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    before = _keys(file_store, "show", "--keys", str(folder)).output

    _keys(file_store, "renew", "--keys", str(folder), "--timestamp-hours", "6")

    assert _keys(file_store, "show", "--keys", str(folder)).output != before
    notes = open_signer(file_store, folder).root_of_trust.with_name("signer.json").read_text()
    assert '"lifetime_h":6' in notes


def test_metadata_that_went_back_is_written_back(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    (key,) = [key for key in file_store.keys("trust") if key.endswith("timestamp.json")]
    older = file_store.get(key).body
    _keys(file_store, "renew", "--keys", str(folder))
    file_store.put(key, older)
    with pytest.raises(TrustRefused, match="simyard fleet keys restore"):
        _keys(file_store, "renew", "--keys", str(folder))

    told = _keys(file_store, "restore", "--keys", str(folder)).output

    assert told == f"version 2 is in {file_store.url} again\n"
    assert _keys(file_store, "renew", "--keys", str(folder)).output == "renewed\n"


@pytest.fixture
def yard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SIMYARD_STORE", (tmp_path / "store").as_uri())
    monkeypatch.delenv("SIMYARD_KEYS", raising=False)
    monkeypatch.chdir(tmp_path)
    init_keys(open_store(), tmp_path / "keys")
    return tmp_path


def test_the_kit_has_the_root_of_trust_of_the_keys(yard: Path) -> None:
    done = CliRunner().invoke(app, ["fleet", "agent-kit", "kit", "--keys", "keys"])

    assert done.exit_code == 0, done.output
    assert (yard / "kit/root.json").read_bytes() == (yard / "keys" / ROOT_FILE).read_bytes()
    assert (yard / "store").as_uri() in (yard / "kit/agent.env").read_text()
    assert not list((yard / "kit").glob("*.pem"))


def test_a_kit_without_keys_must_be_asked_for_by_name(yard: Path) -> None:
    refused = CliRunner().invoke(app, ["fleet", "agent-kit", "kit"])

    assert isinstance(refused.exception, DocumentError)
    assert "--unsigned" in str(refused.exception)
    assert not (yard / "kit").exists()
    assert CliRunner().invoke(app, ["fleet", "agent-kit", "kit", "--unsigned"]).exit_code == 0
    assert not (yard / "kit/root.json").exists()
