"""The keys that vouch for deployments, on the command line."""

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from specs.arn import arn
from specs.errors import DocumentError, TrustRefused
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.trust.signed_fleets import SignedFleets
from tasks.deploy.trust.signer import open_signer
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id


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
