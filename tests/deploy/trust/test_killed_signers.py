"""A signer that dies between two of its writes leaves what robots can verify, and what the next signer goes on from."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from specs.errors import TrustRefused
from tasks.deploy.fleet.states import Desired
from tasks.deploy.trust import keyring
from tasks.deploy.trust.keyring import ROLES
from tasks.deploy.trust.repository import init_keys, restore_metadata
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import NEWER, OLDER, Owner
from tests.deploy.yard import Yard

pytestmark = pytest.mark.long

_MOST_STEPS = 40
CHILD = """
import os, signal, sys
from pathlib import Path
from tasks.deploy.trust import keyring
from tasks.deploy.trust.repository import open_repository, rotate_key
from tasks.storage.backends.local import LocalStore
left = int(sys.argv[3])
def mortal(write):
    def kill(*arguments, **more):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return write(*arguments, **more)
    return kill
for name in ("put", "create", "replace"):
    setattr(LocalStore, name, mortal(getattr(LocalStore, name)))
keyring._write = mortal(keyring._write)
store = LocalStore(Path(sys.argv[1]))
with open_repository(store, keyring.keyring(Path(sys.argv[2]), store)) as session:
    rotate_key(session, "timestamp")
"""


class Killed(BaseException):
    """Nothing catches it, as nothing catches SIGKILL."""


class Death:
    """Comes at the nth write to the store or to the folder of keys, before it or after it.

    Attributes:
        left: Writes until then; negative when it came.
    """

    def __init__(self, nth: int, *, after: bool) -> None:
        self.left = nth
        self.after = after

    def of(self, write: Callable[..., object]) -> Callable[..., object]:
        def mortal(*arguments: object, **more: object) -> object:
            if any("claims/" in str(each) for each in arguments[:1]):
                return write(*arguments, **more)
            self.left -= 1
            if self.left == 0 and not self.after:
                raise Killed
            result = write(*arguments, **more)
            if self.left == 0:
                raise Killed
            return result

        return mortal


class MortalStore:
    def __init__(self, store: Store, death: Death) -> None:
        self.url = store.url
        self._store = store
        self._death = death

    def __getattr__(self, name: str) -> Callable[..., object]:
        method = getattr(self._store, name)
        return self._death.of(method) if name in {"put", "create", "replace"} else method


def _deaths() -> Iterator[Death]:
    for after in (False, True):
        for nth in range(1, _MOST_STEPS):
            death = Death(nth, after=after)
            yield death
            if death.left > 0:  # it never came: the work has fewer steps
                break
        else:
            pytest.fail("more steps than this test tries")


def _dies(owner: Owner, work: Callable[[], object], death: Death, monkeypatch: pytest.MonkeyPatch) -> None:
    immortal = owner.store
    with monkeypatch.context() as patch:
        patch.setattr(keyring, "_write", death.of(keyring._write))
        owner.store = MortalStore(immortal, death)  # pyright: ignore[reportAttributeAccessIssue] - forwards every method
        with suppress(Killed):
            work()
    owner.store = immortal


def _verified(verify: Callable[[Desired], int], wanted: Desired, *, replaced: bool) -> None:
    """Verifies; where the deployer's key may have been replaced meanwhile, that and nothing else may be wrong."""
    try:
        verify(wanted)
    except TrustRefused as exc:
        if not (replaced and "deployer's key any more" in str(exc)):
            raise


@pytest.mark.parametrize("work", [*ROLES, "renew", "admit"])
def test_robots_verify_what_a_killed_signer_leaves(
    work: str, owner: Owner, yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    version, other = yard.publish(GOOD), yard.publish(NEWER)
    verify, first_root = owner.verifier(tmp_path / "robot"), owner.root

    def do() -> None:
        if work == "renew":
            owner.renew()
        elif work == "admit":
            owner.rotate("deployer")  # which makes a list without the bundle
            owner.admit(other)
        else:
            owner.rotate(next(role for role in ROLES if role == work))

    for number, death in enumerate(_deaths()):
        wanted = owner.signed(version, 1)
        _dies(owner, do, death, monkeypatch)
        replaced = work in {"deployer", "admit"}
        _verified(verify, wanted, replaced=replaced)
        _verified(owner.verifier(tmp_path / f"new-{number}", first_root), wanted, replaced=replaced)
        do()
        verify(owner.signed(version, 1))
        assert len(list(owner.folder.glob("*.pem"))) == len(ROLES), "keys that nobody accepts are removed"


def test_keys_whose_making_was_cut_short_are_made_by_the_next_attempt(
    yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    version = yard.publish(GOOD)
    for number, death in enumerate(_deaths()):
        folder = tmp_path / f"keys-{death.after}-{number}"
        owner = Owner(yard.store, tmp_path / "any")
        _dies(owner, lambda folder=folder, owner=owner: init_keys(owner.store, folder), death, monkeypatch)

        again = Owner(yard.store, folder)

        again.verifier(tmp_path / f"robot-{death.after}-{number}")(again.signed(version, 1))
        assert len(list(folder.glob("*.pem"))) == len(ROLES)


def test_a_withdrawal_that_was_written_once_is_not_lost_by_who_puts_old_metadata_back(
    owner: Owner, yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    version = yard.publish(GOOD)
    for number, death in enumerate(_deaths()):
        wanted = owner.signed(version, 1, deployment=f"dep-{death.after}-{number}")
        before = owner.metadata()
        _dies(owner, lambda wanted=wanted: owner.signer.withdraw(wanted.deployment), death, monkeypatch)
        written = owner.metadata()[owner.key("timestamp.json")] != before[owner.key("timestamp.json")]
        owner.restore(before)

        try:
            owner.renew()
        except TrustRefused:
            restore_metadata(yard.store, owner.ring)
            owner.renew()

        assert not (written and owner.signer.fleets().fleet_of(wanted.deployment))
        owner.signer.withdraw(wanted.deployment)
        with pytest.raises(TrustRefused, match="is not in force"):
            owner.verifier(tmp_path / f"robot-{death.after}-{number}")(wanted)


@pytest.mark.integration
def test_the_kernel_kills_the_signer_and_the_next_one_takes_over(yard: Yard, tmp_path: Path) -> None:
    owner = Owner(open_store(yard.store.url), tmp_path / "keys")
    version = yard.publish(OLDER)
    verify = owner.verifier(tmp_path / "robot")
    wanted = owner.signed(version, 1)
    for nth in range(1, _MOST_STEPS):
        argv = [sys.executable, "-c", CHILD, str(tmp_path / "store"), str(owner.folder), str(nth)]
        code = subprocess.run(argv, check=False, capture_output=True).returncode
        verify(wanted)
        if code == 0:
            break
        assert code == -signal.SIGKILL
    owner.renew()
    verify(wanted)
