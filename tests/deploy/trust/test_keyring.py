"""Where private keys lie, who may read them, and that they are nowhere else."""

import base64
import errno
import logging
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from specs.errors import DocumentError, SimyardError, StoreFull
from tasks.deploy.trust.keyring import ROLES, checked_role, keyring
from tasks.deploy.trust.repository import init_keys, open_repository
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner, asked
from tests.deploy.yard import Yard


def test_only_their_owner_can_read_private_keys(file_store: Store, tmp_path: Path) -> None:
    folder = init_keys(file_store, tmp_path / "deep" / "keys").folder

    private = sorted(folder.glob("*.pem"))
    assert sorted({path.name.split("-")[0] for path in private}) == sorted(ROLES)
    assert {stat.S_IMODE(path.stat().st_mode) for path in private} == {0o600}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize("place", ["store/keys", "store", "link/keys", "store/deep/../keys"])
def test_keys_are_never_made_in_the_store(place: str, file_store: Store, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "store")

    with pytest.raises(DocumentError, match="private keys never lie in the store"):
        init_keys(file_store, tmp_path / place)

    assert list((tmp_path / "store").rglob("*.pem")) == []


def test_a_key_that_others_can_read_is_refused_with_the_remedy(file_store: Store, tmp_path: Path) -> None:
    ring = init_keys(file_store, tmp_path / "keys")
    (key,) = ring.folder.glob("deployer-*.pem")
    key.chmod(0o640)

    with pytest.raises(DocumentError, match=f"chmod 600 {key}"):
        ring.find("deployer", ["any"])


@pytest.mark.parametrize("body", [b"", b"no key", b"-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n"])
def test_what_is_no_key_is_refused(body: bytes, file_store: Store, tmp_path: Path) -> None:
    ring = init_keys(file_store, tmp_path / "keys")
    (key,) = ring.folder.glob("deployer-*.pem")
    key.write_bytes(body)

    with pytest.raises(DocumentError, match="an Ed25519 private key"):
        ring.find("deployer", ["any"])


def test_keys_are_for_one_store(file_store: Store, tmp_path: Path) -> None:
    init_keys(file_store, tmp_path / "keys")
    other = open_store((tmp_path / "other").as_uri())

    with pytest.raises(DocumentError, match="these are for the store with id"):
        init_keys(other, tmp_path / "keys")
    with (
        pytest.raises(DocumentError, match="these are for the store with id"),
        open_repository(other, keyring(tmp_path / "keys", other)),
    ):
        pass


def test_a_folder_without_keys_is_refused_with_the_remedy(file_store: Store, tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="simyard fleet keys init --keys DIR"):
        keyring(tmp_path / "nowhere", file_store)
    (tmp_path / "empty").mkdir()
    with (
        pytest.raises(DocumentError, match="simyard fleet keys init --keys DIR"),
        open_repository(file_store, keyring(tmp_path / "empty", file_store)),
    ):
        pass


def test_a_role_that_does_not_exist_is_refused() -> None:
    with pytest.raises(DocumentError, match="root, targets, deployer, snapshot, timestamp"):
        checked_role("captain")


@pytest.mark.parametrize(("above", "mode"), [("shared", 0o777), ("shared", 0o770), ("shared/mine", 0o720)])
def test_keys_are_not_made_where_others_could_exchange_them(
    above: str, mode: int, file_store: Store, tmp_path: Path
) -> None:
    (tmp_path / "shared" / "mine").mkdir(parents=True)
    (tmp_path / above).chmod(mode)

    with pytest.raises(DocumentError, match=f"chmod go-w {tmp_path / above}$"):
        init_keys(file_store, tmp_path / "shared" / "mine" / "keys")

    assert not (tmp_path / "shared" / "mine" / "keys").exists()


def test_a_shared_folder_in_which_nobody_renames_what_is_others_may_hold_keys(
    file_store: Store, tmp_path: Path
) -> None:
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)

    assert init_keys(file_store, tmp_path / "shared" / "keys").root


def test_a_folder_of_keys_that_was_opened_to_others_is_refused_until_it_is_closed(
    file_store: Store, tmp_path: Path
) -> None:
    folder = init_keys(file_store, tmp_path / "keys").folder
    folder.chmod(0o770)

    with pytest.raises(DocumentError, match=f"chmod go-w {folder}$"):
        keyring(folder, file_store)

    folder.chmod(0o700)
    assert keyring(folder, file_store).root


def test_keys_are_not_made_in_somebody_elses_folder(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "keys").mkdir(mode=0o755)
    monkeypatch.setattr("os.geteuid", lambda: 12345)

    with pytest.raises(DocumentError, match=r"sudo chown .*\$\(id -u\)"):
        init_keys(file_store, tmp_path / "keys")


def test_robots_of_this_machine_get_keys_in_a_cache_of_any_kind(file_store: Store, tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o775)

    assert init_keys(file_store, tmp_path / "cache" / "keys" / "any", in_cache=True).root


def private_forms(folder: Path) -> Iterator[bytes]:
    """Yields each private key as PEM's base64, raw, hex and base64."""
    for path in folder.glob("*.pem"):
        pem = path.read_bytes()
        key = load_pem_private_key(pem, password=None)
        assert isinstance(key, Ed25519PrivateKey)
        raw = key.private_bytes_raw()
        yield from (pem.splitlines()[1], raw, raw.hex().encode(), base64.b64encode(raw).rstrip(b"="))


def test_no_private_key_is_anywhere_but_in_its_folder(
    owner: Owner, yard: Yard, careful: CarefulRobot, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    forms = set(private_forms(owner.folder))
    careful.look(asked(owner, yard.publish(GOOD), "one"))
    owner.rotate("root", "targets", "snapshot", "timestamp", "deployer")
    owner.renew()
    careful.look(asked(owner, yard.publish(NEWER), "two"))
    forms |= set(private_forms(owner.folder))
    told: list[str] = [repr(owner.signer), repr(owner.ring), str(vars(owner.signer))]
    try:
        (owner.folder / "root.json").write_bytes(b"{}")
        owner.renew()
    except SimyardError as exc:
        told.append(str(exc))

    places = [path for path in tmp_path.rglob("*") if path.is_file() and not path.is_relative_to(owner.folder)]
    assert len(forms) == 4 * 10
    assert len(places) > 20
    for place in places:
        body = place.read_bytes()
        assert not [form for form in forms if form in body], f"a private key is in {place}"
    text = (caplog.text + "".join(told)).encode()
    assert not [form for form in forms if form in text]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_under_the_keys_is_named(
    code: int, file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(code, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    ring = keyring(tmp_path, file_store)
    with pytest.raises(StoreFull, match=f"No space left on device: {tmp_path} has .* MiB free"):
        ring.save_root(b"{}")
    assert [path.name for path in tmp_path.iterdir() if "root" in path.name] == []
