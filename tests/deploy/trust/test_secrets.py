"""No byte of a private key is in the store, in a log, in a record or on a robot."""

import base64
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from specs.errors import SimyardError
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner, asked
from tests.deploy.yard import Yard


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


def test_no_private_key_is_in_a_bucket(anywhere: Owner, tmp_path: Path) -> None:
    version = Yard(anywhere.store, tmp_path).publish(GOOD)
    anywhere.signed(version, 1)
    anywhere.rotate("deployer")

    forms = set(private_forms(anywhere.folder))
    for key in anywhere.store.keys(""):
        body = anywhere.store.get(key).body
        assert b"PRIVATE KEY" not in body
        assert not [form for form in forms if form in body], f"a private key is in {key}"
