"""Access keys: what they are limited to, and the file that keeps them."""

import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from botocore.configloader import raw_config_parse

from specs.arn import ResourceKind
from specs.errors import DocumentError, ResourceAlreadyExists, ResourceNotFound
from tasks.gateway.access.access_keys import (
    KeyFile,
    add_key,
    first_key,
    parse_scope,
    read_keys,
    revoke_key,
)

STORE = "0123456789abcdef"


@pytest.mark.parametrize(
    ("text", "path", "covered"),
    [
        ("deployment-fleet/home", "home", True),
        ("deployment-fleet/home", "home-2", False),
        ("deployment-fleet/home", "hom", False),
        ("deployment-fleet/home*", "home-2", True),
        ("deployment-fleet/*", "other", True),
        ("robot/home", "home", False),
        ("robot/*", "home", False),
        (f"arn:simyard:deployment-fleet:{STORE}:home", "home", True),
        (f"arn:simyard:deployment-fleet:{STORE}:*", "home", True),
        ("arn:simyard:deployment-fleet:another:home", "home", False),
        ("arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/home/1600000000000", "home", True),
        ("arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/ho*", "home", True),
    ],
)
def test_a_scope_covers_what_it_names(text: str, path: str, covered: bool) -> None:  # noqa: FBT001 - a case
    assert parse_scope(text).covers("deployment-fleet", path, STORE) is covered


@pytest.mark.parametrize(
    ("text", "kind", "whole"),
    [
        ("robot/*", "robot", True),
        ("robot/a*", "robot", False),
        ("robot/a", "robot", False),
        ("world/*", "robot", False),
        ("arn:simyard:robot:another:*", "robot", False),
    ],
)
def test_a_whole_kind_is_covered_by_an_asterisk_alone(text: str, kind: ResourceKind, whole: bool) -> None:  # noqa: FBT001
    assert parse_scope(text).covers_all(kind, STORE) is whole


@pytest.mark.parametrize(
    "text", ["", "*", "home", "fleet/home", "robot/", "robot/*a", "robot/a b", "arn:aws:s3:::b", "arn:"]
)
def test_a_text_that_names_nothing_is_refused(text: str) -> None:
    with pytest.raises(DocumentError, match="KIND/NAME"):
        parse_scope(text)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "simyard" / "access-keys"


def test_the_first_key_may_do_everything(path: Path) -> None:
    key = first_key(path)
    assert key is not None
    assert (key.name, key.rights, key.scopes) == ("default", {"read", "simulate", "deploy"}, ())
    assert dict(read_keys(path)) == {key.key_id: key}


def test_there_is_a_first_key_only_once(path: Path) -> None:
    first_key(path)
    before = path.read_text()
    assert first_key(path) is None
    assert path.read_text() == before


def test_nobody_else_can_read_the_file(path: Path) -> None:
    first_key(path)
    add_key(path, "ci", ["read"])
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_client_of_aws_reads_the_file(path: Path) -> None:
    key = add_key(path, "ci", ["read", "simulate"], ["robot-application/*", "simulation-job/*"])
    profile = raw_config_parse(str(path))["ci"]
    assert (profile["aws_access_key_id"], profile["aws_secret_access_key"]) == (key.key_id, key.secret)


def test_a_secret_is_not_shown_with_its_key(path: Path) -> None:
    key = add_key(path, "ci", ["read"])
    assert key.secret not in repr(key)


def test_a_name_is_taken_once(path: Path) -> None:
    add_key(path, "ci", ["read"])
    with pytest.raises(ResourceAlreadyExists, match="a new name"):
        add_key(path, "ci", ["deploy"])


@pytest.mark.parametrize(
    ("name", "rights", "on"),
    [("ci", [], []), ("ci", ["admin"], []), ("a b", ["read"], []), ("DEFAULT", ["read"], []), ("ci", ["read"], ["x"])],
)
def test_a_key_that_is_none_is_refused_and_changes_nothing(
    path: Path, name: str, rights: list[str], on: list[str]
) -> None:
    with pytest.raises(DocumentError):
        add_key(path, name, rights, on)
    assert not path.exists()


def test_a_revoked_key_is_gone_at_once(path: Path) -> None:
    kept, gone = add_key(path, "kept", ["read"]), add_key(path, "gone", ["read"])
    keys = KeyFile(path)
    assert keys.key(gone.key_id) == gone
    revoke_key(path, "gone")
    assert keys.key(gone.key_id) is None
    assert keys.key(kept.key_id) == kept


def test_a_key_is_revoked_by_its_id(path: Path) -> None:
    key = add_key(path, "ci", ["read"])
    assert revoke_key(path, key.key_id) == key
    with pytest.raises(ResourceNotFound, match="simyard access list"):
        revoke_key(path, "ci")


def test_a_new_key_is_known_at_once(path: Path) -> None:
    keys = KeyFile(path)
    assert keys.key("x") is None
    key = add_key(path, "ci", ["read"])
    assert keys.key(key.key_id) == key


def test_no_key_is_known_while_the_file_is_gone(path: Path) -> None:
    key = add_key(path, "ci", ["read"])
    keys = KeyFile(path)
    assert keys.key(key.key_id)
    path.unlink()
    assert keys.key(key.key_id) is None


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602])
def test_a_file_that_others_can_read_or_write_is_refused(path: Path, mode: int) -> None:
    key = add_key(path, "ci", ["read"])
    keys = KeyFile(path)
    assert keys.key(key.key_id)
    path.chmod(mode)
    for _ in range(2):  # and not believed the next time either
        with pytest.raises(DocumentError, match="chmod 600"):
            keys.key(key.key_id)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("[ci]", "ci]"),
        lambda text: text + text,
        lambda text: text.replace("simyard_rights = read", "simyard_rights = all"),
        lambda text: text.replace("simyard_rights = read", ""),
        lambda text: text.replace("simyard_on = robot/a", "simyard_on ="),
        lambda text: text.replace("simyard_on", "simyard_onn"),
        lambda text: text + text.replace("[ci]", "[other]"),
    ],
)
def test_a_file_that_is_not_understood_is_refused_and_its_secrets_are_not_shown(path: Path, change) -> None:  # type: ignore[no-untyped-def] # noqa: ANN001
    key = add_key(path, "ci", ["read"], ["robot/a"])
    text = change(path.read_text())
    assert text != path.read_text()
    path.write_text(text)
    with pytest.raises(DocumentError) as caught:
        read_keys(path)
    assert key.secret not in str(caught.value)
    assert caught.value.__cause__ is None


def test_of_keys_that_are_added_at_once_all_are_there(path: Path) -> None:
    names = [f"key-{number}" for number in range(12)]
    with ThreadPoolExecutor(6) as threads:
        made = list(threads.map(lambda name: add_key(path, name, ["read"]), names))
    assert {key.name for key in read_keys(path).values()} == {*names}
    assert len({key.secret for key in made}) == len(names)
