"""The work of the owner of the keys: make keys, renew the metadata, replace a key, put back what was replaced.

One process at a time works on a repository: a lock on the folder of keys, and a claim in the store. Every change is
written so that robots can verify what is there at every moment, also when the writer is killed between any two writes.
"""

import logging
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from uuid import uuid4

from specs.errors import TrustRefused
from tasks.deploy.trust.kept_metadata import KIND, check_version, finish, keep, remember
from tasks.deploy.trust.keyring import ROLES, Keyring, Role, SignerNotes, keyring
from tasks.deploy.trust.metadata import (
    REPOSITORY_FIELD,
    Published,
    delegate,
    read_published,
    read_root,
)
from tasks.deploy.trust.metadata_writer import LIFETIMES, Pen, write, write_root
from tasks.deploy.trust.tuf_names import CryptoSigner, Metadata, MetaFile, Root, Snapshot, Targets, Timestamp
from tasks.deploy.trust.vouched_fleets import VouchedFleets, write_fleets
from tasks.storage.base.keys import claim_key, trust_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, hold_claim
from tasks.storage.store_url import store_id

_LOG = logging.getLogger(__name__)
Clock = Callable[[], datetime]
_TOP: tuple[Role, ...] = ("root", "targets", "snapshot", "timestamp")


def utc_now() -> datetime:
    """Returns the time."""
    return datetime.now(UTC)


def init_keys(store: Store, folder: Path, *, clock: Clock = utc_now, in_cache: bool = False) -> Keyring:
    """Returns a folder of keys whose metadata is in the store; makes what is missing, changes nothing.

    Args:
        store: Which store the keys are for.
        folder: Where the private keys lie; outside the store.
        clock: Tells the time.
        in_cache: Whether the folder is the one of this machine's own robots.

    Raises:
        DocumentError: The folder lies in the store, others can write to it, or its keys are for another store.
        TrustRefused: The store had metadata for these keys once, and has lost it.
        StoreError: The store fails.
    """
    ring = keyring(folder, store, make=True, in_cache=in_cache)
    with ring.alone():
        notes = ring.notes or SignerNotes(repository=uuid4().hex[:12], store=store_id(store))
        ring.save_notes(notes)
        ring.check_store(notes, store)
        body = ring.root
        if body is None:
            body = _first_root(ring, notes.repository, clock())
            ring.save_root(body)
        with hold_claim(store, claim_key(KIND, notes.repository)) as claim:
            if not store.exists(trust_key(notes.repository, "timestamp.json")):
                _publish_first(store, ring, notes, now=clock(), claim=claim, body=body)
    return ring


@dataclass
class Session:
    """A repository that this process alone changes.

    Attributes:
        state: The newest metadata, verified.
    """

    store: Store
    ring: Keyring
    state: Published
    now: datetime
    claim: Claim

    @property
    def lifetimes(self) -> Mapping[Role, timedelta]:
        """How long each role's metadata is accepted."""
        notes = self.ring.notes
        return {**LIFETIMES, "timestamp": timedelta(hours=notes.lifetime_h)} if notes else LIFETIMES

    def choose_lifetime(self, hours: int) -> None:
        """Has timestamps signed for so many hours from now on."""
        if notes := self.ring.notes:
            self.ring.save_notes(notes.model_copy(update={"lifetime_h": hours}))

    def due(self, role: Role) -> bool:
        """Returns whether less than half of a role's time is left."""
        return self.state.expires(role) - self.now < self.lifetimes[role] / 2

    def at_hand(self, role: Role) -> bool:
        """Returns whether the role's private key is here."""
        return self.ring.find(role, self.state.keyids(role)) is not None

    def commit(self, changed: Sequence[Role], more: Mapping[Role, CryptoSigner] | None = None) -> None:
        """Writes the changed parts and the snapshot, signed by their keys and the ones in ``more``."""
        self._write((*changed, "snapshot"), more or {})

    def commit_timestamp(self) -> None:
        """Signs the timestamp anew, and nothing else."""
        self._write((), {})

    def _write(self, changed: Sequence[Role], more: Mapping[Role, CryptoSigner]) -> None:
        signers: dict[Role, list[CryptoSigner]] = {}
        for role in (*changed, "timestamp"):
            signers[role] = [self.ring.get(role, self.state.keyids(role))]
            if role in more:
                signers[role].append(more[role])
        pen = Pen(signers, self.now, self.lifetimes, self.claim, partial(keep, self.ring, settled=False))
        write(self.store, self.state, changed, pen)
        remember(self.ring, self.state)

    def commit_root(self, signers: Sequence[CryptoSigner]) -> None:
        """Writes the next root."""
        self.state.root.signed.version += 1
        self.ring.save_root(write_root(self.store, self.state.root, signers, self.now))


@contextmanager
def open_repository(store: Store, ring: Keyring, *, clock: Clock = utc_now) -> Generator[Session]:
    """Yields the repository that the keys are for, to this process alone.

    Raises:
        DocumentError: There are no keys, or they are for another store.
        TrustRefused: The metadata in the store is not what the keys signed, or is older than it was.
        StoreError: The store fails.
    """
    with ring.alone():
        notes, root = ring.known_for(store)
        with hold_claim(store, claim_key(KIND, notes.repository)) as claim:
            finish(store, ring, notes)
            session = Session(store, ring, read_published(store, read_root(root)), clock(), claim)
            check_version(store, ring, notes, session.state)
            remember(ring, session.state)
            yield session


def look_at_repository(store: Store, ring: Keyring) -> Published:
    """Returns the newest metadata, verified; it may be written anew at the same time.

    Raises:
        DocumentError: There are no keys, or they are for another store.
        TrustRefused: The metadata in the store is not what the keys signed, or is older than it was.
        StoreError: The store fails.
    """
    notes, root = ring.known_for(store)
    state = read_published(store, read_root(root))
    check_version(store, ring, notes, state)
    return state


def renew_metadata(session: Session) -> list[Role]:
    """Signs everything anew that expires and whose key is at hand; returns what is due, and whose key is not.

    Root and targets, whose keys lie elsewhere most of the time, are signed anew in the second half of their time.
    """
    if session.due("root") and session.at_hand("root"):
        session.commit_root([session.ring.get("root", session.state.keyids("root"))])
    changed: list[Role] = ["targets"] if session.due("targets") and session.at_hand("targets") else []
    session.commit([*changed, *(["deployer"] if session.at_hand("deployer") else [])])
    return [role for role in ROLES if session.due(role)]


def refresh_metadata(session: Session) -> list[Role]:
    """Signs anew what is in the second half of its time; returns what is due, and whose key is not here."""
    if any(session.due(role) and session.at_hand(role) for role in ROLES if role != "timestamp"):
        return renew_metadata(session)
    if session.due("timestamp") and session.at_hand("timestamp"):
        session.commit_timestamp()
    return [role for role in ROLES if session.due(role)]


def rotate_key(session: Session, role: Role) -> None:
    """Replaces a key: what the old one signs is refused from now on.

    A new deployer's key begins with an empty list of bundles and with no fleets: what a thief may have put there is
    gone. The owner vouches for the robots again, and the next deployment lists its bundle.

    Raises:
        DocumentError: Root's key, or for the deployer's key that of targets, is not here.
    """
    if role == "root":
        _rotate_root(session)
    elif role == "deployer":
        session.ring.get("targets", session.state.keyids("targets"))
        delegate(session.state.targets.signed, session.ring.create("deployer"))
        write_fleets(session.state.deployer.signed, VouchedFleets())
        session.commit(["targets", "deployer"])
    else:
        _rotate_top(session, role)
    session.ring.keep_only(role, session.state.keyids(role))


def _rotate_root(session: Session) -> None:
    root, before = session.state.root.signed, session.state.keyids("root")
    old, new = session.ring.get("root", before), session.ring.create("root")
    _replace_key(root, "root", new)
    session.commit_root([old, new])


def _rotate_top(session: Session, role: Role) -> None:
    """Signs with both keys first, so that there is no moment at which robots can verify neither old nor new."""
    root_signer = session.ring.get("root", session.state.keyids("root"))
    changed: list[Role] = [role] if role == "targets" else []
    both, new = session.at_hand(role), session.ring.create(role)
    if both:
        session.commit(changed, {role: new})
    _replace_key(session.state.root.signed, role, new)
    session.commit_root([root_signer])
    if not both:  # the old key is lost: robots refuse what is new until this is written
        session.commit(changed)


def _replace_key(root: Root, role: Role, new: CryptoSigner) -> None:
    for keyid in list(root.roles[role].keyids):
        root.revoke_key(keyid, role)
    root.add_key(new.public_key, role)


def _first_root(ring: Keyring, repository: str, now: datetime) -> bytes:
    root = Root(consistent_snapshot=True, unrecognized_fields={REPOSITORY_FIELD: repository})
    root.expires = (now + LIFETIMES["root"]).replace(microsecond=0)
    signers: dict[Role, CryptoSigner] = {role: ring.create(role) for role in _TOP}
    for role, signer in signers.items():
        root.add_key(signer.public_key, role)
        ring.keep_only(role, [signer.public_key.keyid])
    metadata = Metadata(root)
    metadata.sign(signers["root"])
    return metadata.to_bytes()


def _publish_first(
    store: Store, ring: Keyring, notes: SignerNotes, *, now: datetime, claim: Claim, body: bytes
) -> None:
    if notes.timestamp:
        where = f"{store.url}/trust/{notes.repository}"
        raise TrustRefused(f"{where} is gone: restore it from a backup, or make new keys and give robots their root")
    root = read_root(body)
    name = trust_key(notes.repository, f"{root.signed.version}.root.json")
    store.put(name, body)  # the same bytes, if an earlier attempt came as far
    state = Published(root, Metadata(Targets()), Metadata(Targets()), Metadata(Snapshot()), Metadata(Timestamp()))
    for part in (state.targets, state.deployer, state.snapshot, state.timestamp):
        part.signed.version = 0  # each is counted up when it is written
    state.snapshot.signed.meta = {"targets.json": MetaFile(), "deployer.json": MetaFile()}
    deployer = ring.create("deployer")
    delegate(state.targets.signed, deployer)
    write_fleets(state.deployer.signed, VouchedFleets())
    session = Session(store, ring, state, now, claim)
    session.commit(["targets", "deployer"])
    ring.keep_only("deployer", [deployer.public_key.keyid])
