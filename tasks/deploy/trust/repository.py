"""The work of the owner of the keys: make keys, renew the metadata, replace a key, put back what was replaced.

The metadata is written in an order in which robots can verify it at every moment. The owner keeps a copy of the newest
in the folder of keys: what the store shows must not be older.
"""

import logging
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from uuid import uuid4

from specs.errors import ObjectExists, ObjectNotFound, ObjectTooBig, TrustRefused
from tasks.deploy.trust.keyring import (
    ROLES,
    CryptoSigner,
    DeserializationError,
    KeptMetadata,
    Keyring,
    Metadata,
    MetaFile,
    Role,
    Root,
    SignerNotes,
    Snapshot,
    Targets,
    Timestamp,
    keyring,
    refused_keys,
)
from tasks.deploy.trust.metadata import (
    MOST_METADATA_BYTES,
    REPOSITORY_FIELD,
    Part,
    Published,
    delegate,
    part_name,
    read_published,
    read_root,
    repository_of,
)
from tasks.deploy.trust.signed_fleets import SignedFleets, write_fleets
from tasks.storage.base.keys import claim_key, trust_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, hold_claim
from tasks.storage.store_url import store_id

KIND = "trust"
"""Of the claim on a repository."""
_NEWEST = part_name("timestamp", 0)
# How long a stolen key, or a store that shows nothing new, can go unnoticed at most; each has its own cost of renewal.
LIFETIMES: Mapping[Role, timedelta] = {
    "root": timedelta(days=730),
    "targets": timedelta(days=365),
    "deployer": timedelta(days=90),
    "snapshot": timedelta(days=30),
    "timestamp": timedelta(days=1),
}
Signers = Mapping[Role, Sequence[CryptoSigner]]
_LOG = logging.getLogger(__name__)
Clock = Callable[[], datetime]
_TOP: tuple[Role, ...] = ("root", "targets", "snapshot", "timestamp")


# A writer keeps the copy before the last of its writes. So whoever comes after one that was killed finishes its work,
# and whoever finds an older state than the copy knows that somebody has put it back.
def keep(ring: Keyring, version: int, parts: Mapping[str, bytes], *, settled: bool) -> None:
    """Keeps a state, by file name; ``settled`` says whether it is in the store already."""
    texts = {name: body.decode() for name, body in parts.items()}
    ring.keep(KeptMetadata(version=version, parts=texts, settled=settled))


def remember(ring: Keyring, state: Published) -> None:
    """Keeps the newest state that was seen in the store, so that nothing older is built upon."""
    version, notes, kept = state.timestamp.signed.version, ring.notes, ring.kept
    if kept is None or kept.version < version or not kept.settled:
        keep(ring, version, dict(state.bodies.values()), settled=True)
    if notes and notes.timestamp < version:
        ring.save_notes(notes.model_copy(update={"timestamp": version}))


def check_version(store: Store, ring: Keyring, notes: SignerNotes, state: Published) -> None:
    """Does nothing for a state that is not older than what these keys have seen.

    Raises:
        TrustRefused: It is.
    """
    kept, version = ring.kept, state.timestamp.signed.version
    newest = max(notes.timestamp, kept.version - (not kept.settled) if kept else 0)
    if version < newest:
        what = f"{store.url}/trust/{notes.repository} went back to version {version}, after {newest}"
        back = "then write back what these keys signed last: simyard fleet keys restore"
        raise TrustRefused(f"{what}; find out who writes to the store; {back}")


def finish(store: Store, ring: Keyring, notes: SignerNotes) -> None:
    """Writes what a writer that was killed had signed and may not have written; else an older state would count."""
    kept = ring.kept
    if kept and not kept.settled and _version_in(store, notes) == kept.version - 1:
        put_back(store, notes, kept)


def put_back(store: Store, notes: SignerNotes, kept: KeptMetadata) -> None:
    """Writes a kept state into the store; what makes the rest of it count comes last."""
    for name in sorted(kept.parts, key=lambda name: name == _NEWEST):
        store.put(trust_key(notes.repository, name), kept.parts[name].encode())


def restore_metadata(store: Store, ring: Keyring) -> int:
    """Writes back the newest metadata that was signed with these keys, and returns the version of its timestamp.

    Raises:
        DocumentError: There are no keys, or they are for another store.
        TrustRefused: Newer metadata is known, or is in the store.
        StoreError: The store fails.
    """
    with ring.alone():
        (notes, root), kept = ring.known_for(store), ring.kept
        if kept is None:
            raise refused_keys(ring.folder, "keys that have signed something in this folder")
        with hold_claim(store, claim_key(KIND, notes.repository)):
            newest = read_root(root)
            store.put(trust_key(notes.repository, part_name("root", newest.signed.version)), root)
            with suppress(TrustRefused):  # of what cannot be verified, no version counts
                if read_published(store, newest).timestamp.signed.version > kept.version:
                    raise refused_keys(ring.folder, f"the keys that signed last; version {kept.version} was theirs")
            put_back(store, notes, kept)
            remember(ring, read_published(store, newest))
        return kept.version


def _version_in(store: Store, notes: SignerNotes) -> int:
    """Returns the version of the timestamp in the store, which nobody has verified yet; 0 for none."""
    try:
        body = store.get(trust_key(notes.repository, _NEWEST), MOST_METADATA_BYTES).body
        return Metadata[Timestamp].from_bytes(body).signed.version
    except (ObjectNotFound, ObjectTooBig, DeserializationError):
        return 0


# The owner keeps a copy of the new state (`keep`) before the last write makes it count.
@dataclass(frozen=True)
class MetadataWriter:
    """What a writer of metadata has.

    Attributes:
        signers: Who signs each of the parts that are written, one or more.
        now: The signer's clock.
        lifetimes: How long each part is accepted.
        claim: This process's claim on the repository.
        keep: Keeps the new state, by file name, with its version, before it counts.
    """

    signers: Signers
    now: datetime
    lifetimes: Mapping[Role, timedelta]
    claim: Claim
    keep: Callable[[int, Mapping[str, bytes]], None]


def write(store: Store, state: Published, changed: Sequence[Role], writer: MetadataWriter) -> None:
    """Writes the changed parts under new versions, then what refers to them; the last write makes all of it count.

    Args:
        store: Where to.
        state: The state; its parts get their versions, dates and signatures here.
        changed: Those of ``targets``, ``deployer`` and ``snapshot`` that have to be written; the snapshot always is
            with one of the others.
        writer: What it is written with.

    Raises:
        TrustRefused: Another process has taken the repository over, or a part is larger than robots read.
        StoreError: The store fails.
    """
    snapshot, timestamp = state.snapshot.signed, state.timestamp.signed
    for role in changed:
        if role != "snapshot":
            snapshot.meta[f"{role}.json"] = _write_next(store, state, role, writer)
    if changed:
        timestamp.snapshot_meta = _write_next(store, state, "snapshot", writer)
    timestamp.version += 1
    body = _sign(state.timestamp, "timestamp", writer)
    if writer.claim.lost:
        raise TrustRefused("another process has taken over the signing; try again")
    state.bodies["timestamp"] = (part_name("timestamp", timestamp.version), body)
    writer.keep(timestamp.version, dict(state.bodies.values()))
    store.put(trust_key(state.repository, "timestamp.json"), body)


def write_root(store: Store, root: Metadata[Root], signers: Sequence[CryptoSigner], now: datetime) -> bytes:
    """Returns the bytes of the next root metadata, signed by all the signers and written; it counts at once.

    Args:
        store: Where to.
        root: The metadata, under its new version; gets its date and signatures here.
        signers: Who signs it.
        now: The signer's clock.

    Raises:
        TrustRefused: There is another one under the version.
    """
    body = _signed(root, signers, now + LIFETIMES["root"])
    name = part_name("root", root.signed.version)
    try:
        store.create(trust_key(repository_of(root), name), body)
    except ObjectExists as exc:
        raise TrustRefused(f"another process wrote {name} meanwhile; try again") from exc
    return body


def _write_next(store: Store, state: Published, role: Role, writer: MetadataWriter) -> MetaFile:
    metadata = state.part(role)
    metadata.signed.version += 1
    body = _sign(metadata, role, writer)
    name = part_name(role, metadata.signed.version)
    if len(body) > MOST_METADATA_BYTES:
        what = f"{name} would have {len(body)} bytes, and robots read {MOST_METADATA_BYTES} at most"
        raise TrustRefused(f"{what}: divide the robots among several stores, each with its keys")
    store.put(trust_key(state.repository, name), body)
    state.bodies[role] = (name, body)
    return MetaFile.from_data(metadata.signed.version, body, ["sha256"])


def _sign(metadata: Part, role: Role, writer: MetadataWriter) -> bytes:
    return _signed(metadata, writer.signers[role], writer.now + writer.lifetimes[role])


def _signed(metadata: Part, signers: Sequence[CryptoSigner], expires: datetime) -> bytes:
    metadata.signed.expires = expires.replace(microsecond=0)
    metadata.signatures.clear()
    for signer in signers:
        metadata.sign(signer, append=True)
    return metadata.to_bytes()


# One process at a time works on a repository: a lock on the folder of keys, and a claim in the store. Every change is
# written so that robots can verify what is there at every moment, also when the writer is killed between any two
# writes.
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
        writer = MetadataWriter(signers, self.now, self.lifetimes, self.claim, partial(keep, self.ring, settled=False))
        write(self.store, self.state, changed, writer)
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


def read_repository(store: Store, ring: Keyring) -> Published:
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
        write_fleets(session.state.deployer.signed, SignedFleets())
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
    write_fleets(state.deployer.signed, SignedFleets())
    session = Session(store, ring, state, now, claim)
    session.commit(["targets", "deployer"])
    ring.keep_only("deployer", [deployer.public_key.keyid])
