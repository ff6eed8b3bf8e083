"""The owner's key: made once, for its owner alone, and never shown; what it vouches for is exact."""

import pickle
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.storage.jobs.authenticator import MAC_LENGTH, BatchAuthenticator, owner_authenticator, owner_key

KEY = bytes(range(32))


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def test_the_key_is_made_once_and_is_its_owners_alone(tmp_path: Path):
    key = owner_key()
    path = tmp_path / "cache" / "owner" / "key"
    assert (len(key), owner_key(), path.read_bytes()) == (32, key, key)
    assert [oct(each.stat().st_mode & 0o777) for each in (path, path.parent)] == ["0o600", "0o700"]


def test_a_lost_key_is_replaced_by_another(tmp_path: Path):
    before = owner_key()
    (tmp_path / "cache" / "owner" / "key").unlink()
    assert owner_key() != before


def test_machines_of_one_owner_may_share_a_key(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "shared").write_bytes(KEY)
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(tmp_path / "shared"))
    assert owner_key() == KEY


def test_what_is_no_key_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "shared").write_bytes(b"password")
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(tmp_path / "shared"))
    with pytest.raises(DocumentError, match="a file of 32 random bytes"):
        owner_authenticator("simb-1", "plan")


@pytest.mark.parametrize("place", ["file/key", "folder"])
def test_a_key_that_can_neither_be_read_nor_made_is_named_with_what_to_do(
    place: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    (tmp_path / "file").write_text("no folder")
    (tmp_path / "folder").mkdir()
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(tmp_path / place))
    with pytest.raises(DocumentError, match=r"SIMYARD_OWNER_KEY: .*: copy owner/key of the gateway's cache folder"):
        owner_key()


def test_bytes_are_vouched_for_as_what_they_are_and_as_nothing_else():
    authenticator = BatchAuthenticator(KEY, "simb-1", "plan")
    mac = authenticator.mac("chunk 1", b"rows")
    assert len(mac) == MAC_LENGTH
    assert authenticator.authenticates(mac, "chunk 1", b"rows")
    assert not authenticator.authenticates(mac, "chunk 2", b"rows")
    assert not authenticator.authenticates(mac, "chunk 1", b"row")
    assert not authenticator.authenticates(mac, "chunk 1r", b"ows")
    assert not authenticator.authenticates("", "chunk 1", b"rows")
    assert not authenticator.authenticates("\N{SNOWMAN}" * 64, "chunk 1", b"rows")


def test_another_key_batch_or_plan_vouches_for_nothing():
    mac = BatchAuthenticator(KEY, "simb-1", "plan").mac("chunk 1", b"rows")
    others = [
        BatchAuthenticator(KEY[::-1], "simb-1", "plan"),
        BatchAuthenticator(KEY, "simb-2", "plan"),
        BatchAuthenticator(KEY, "simb-1", "another"),
    ]
    assert not any(other.authenticates(mac, "chunk 1", b"rows") for other in others)


def test_a_worker_is_given_the_batchs_key_and_never_the_owners():
    authenticator = BatchAuthenticator(KEY, "simb-1", "plan")
    sent = pickle.dumps(authenticator)
    assert KEY not in sent
    assert pickle.loads(sent).mac("chunk 1", b"rows") == authenticator.mac("chunk 1", b"rows")  # noqa: S301


def test_nobody_who_prints_it_sees_a_key():
    authenticator = BatchAuthenticator(KEY, "simb-1", "plan")
    assert authenticator._key.hex() not in repr(authenticator)
    assert repr(authenticator._key)[2:-1] not in repr(authenticator)
