"""Whatever object somebody spoils who can write to the store, robots run what they ran.

Each attack by itself is in ``tests/deploy/trust/test_attacks.py``.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from specs.errors import StoreError
from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import read_desired
from tasks.deploy.trust.keyring import ROLES
from tasks.storage.base.keys import bundle_key, desired_key
from tasks.storage.base.store import encode_document
from tests.deploy.one_robot import NAME
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner
from tests.deploy.yard import Yard

pytestmark = pytest.mark.integration


@sizes(short=8, long=300)
def test_whatever_object_is_spoiled_nothing_runs_that_was_not_signed(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version, *, size: int, figures: Figures, tmp_path: Path
) -> None:
    dice, refused = Random(size), 0  # noqa: S311 - what is spoiled, and how
    versions = (installed, yard.publish(NEWER))
    for number in range(size):
        version, before = versions[number % 2], careful.runs[0]
        wanted = owner.signed(version, number + 2)
        bundle = bundle_key(version.digest)
        newest = {
            owner.latest(role) for role in ROLES
        }  # what robots read; each deployment leaves older versions behind
        metadata = {key: body for key, body in owner.metadata().items() if key in newest}
        good = {**metadata, bundle: yard.store.get(bundle).body, desired_key(NAME): encode_document(wanted)}
        key = dice.choice(sorted(good))
        yard.store.put(desired_key(NAME), good[desired_key(NAME)])
        yard.store.put(key, _spoiled(good, key, dice))

        # It has forgotten what it verified, so that it needs every object again.
        careful.robot._check = owner.verifier(tmp_path / f"trust-{number}")
        with suppress(StoreError):
            found, _ = read_desired(yard.store, NAME)
            careful.robot.accept(found or wanted)

        ran, programs = careful.runs
        assert ran in {before, version.digest}
        assert programs == 1
        refused += careful.disk.load().sequence != number + 2
        yard.store.put(key, good[key])
    assert refused > 0
    figures(6, kind(yard.store.url), spoiled=size, refused=refused, unsigned_run=0)


def _spoiled(good: Mapping[str, bytes], key: str, dice: Random) -> bytes:
    """Returns an object cut short, with a bit turned over, without its end, or another one."""
    body = bytearray(good[key])
    way = dice.choice(["cut", "bit", "longer", "other"])
    if way == "cut":
        return bytes(body[: dice.randrange(len(body))])
    if way == "bit":
        body[dice.randrange(len(body))] ^= 1 << dice.randrange(8)
        return bytes(body)
    return bytes(body) + b"x" if way == "longer" else good[dice.choice(sorted(good))]
