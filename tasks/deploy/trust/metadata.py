"""The signed metadata of one repository in the store: reads and checks it, and writes it in a safe order.

``trust/<repository>/``: ``<n>.root.json``, ``<n>.targets.json``, ``<n>.deployer.json``, ``<n>.snapshot.json`` and
``timestamp.json``. All but the last are written once under their version; the last names the versions that count, so
writing it is the one moment at which anything changes. Killed before, a writer has changed nothing (TUF specification
1.0.33, sections 6 and 7.1).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from typing import TypeVar

from tuf.api.exceptions import RepositoryError
from tuf.api.serialization import DeserializationError

from specs.errors import ObjectExists, ObjectNotFound, TrustRefused
from tasks.deploy.trust.keyring import Role
from tasks.deploy.trust.tuf_names import (
    CryptoSigner,
    DelegatedRole,
    Delegations,
    Metadata,
    MetaFile,
    Root,
    Snapshot,
    TargetFile,
    Targets,
    Timestamp,
)
from tasks.storage.base.keys import trust_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim

# How long a stolen key, or a store that shows nothing new, can go unnoticed at most; each has its own cost of renewal.
LIFETIMES: Mapping[Role, timedelta] = {
    "root": timedelta(days=730),
    "targets": timedelta(days=365),
    "deployer": timedelta(days=90),
    "snapshot": timedelta(days=30),
    "timestamp": timedelta(days=7),
}
REPOSITORY_FIELD = "x-simyard-repository"
_BUNDLES = "bundles/*"
Signers = Mapping[Role, Sequence[CryptoSigner]]
Part = Metadata[Root] | Metadata[Targets] | Metadata[Snapshot] | Metadata[Timestamp]
Kind = TypeVar("Kind", Root, Targets, Snapshot, Timestamp)


@dataclass(frozen=True)
class Published:
    """One consistent state of the metadata; what it holds is changed in place before it is written again."""

    root: Metadata[Root]
    targets: Metadata[Targets]
    deployer: Metadata[Targets]
    snapshot: Metadata[Snapshot]
    timestamp: Metadata[Timestamp]

    @property
    def repository(self) -> str:
        """Id of the metadata's folder in the store."""
        return repository_of(self.root)

    def keyids(self, role: Role) -> list[str]:
        """Returns the ids of the keys that a role's signatures are accepted from."""
        return list(
            deployer_role(self.targets.signed).keyids if role == "deployer" else self.root.signed.roles[role].keyids
        )

    def expires(self, role: Role) -> datetime:
        """Returns until when a role's metadata is accepted."""
        return self.part(role).signed.expires

    def part(self, role: Role) -> Part:
        """Returns a role's metadata."""
        parts: dict[Role, Part] = {
            "root": self.root,
            "targets": self.targets,
            "deployer": self.deployer,
            "snapshot": self.snapshot,
            "timestamp": self.timestamp,
        }
        return parts[role]


def bundle_target(digest: str) -> str:
    """Returns the target path of a bundle."""
    return f"bundles/{digest}"


def deployer_role(targets: Targets) -> DelegatedRole:
    """Returns who may list bundles and sign desired states, as the targets' key says.

    Raises:
        TrustRefused: It says nothing about that.
    """
    roles = targets.delegations.roles if targets.delegations else None
    if not roles or "deployer" not in roles:
        raise TrustRefused("targets.json names no deployer's key")
    return roles["deployer"]


def delegate(targets: Targets, signer: CryptoSigner) -> None:
    """Makes the key the only one that deploys."""
    key = signer.public_key
    role = DelegatedRole("deployer", [key.keyid], 1, terminating=True, paths=[_BUNDLES])
    targets.delegations = Delegations({key.keyid: key}, {"deployer": role})


def list_bundle(deployer: Targets, digest: str, length: int) -> None:
    """Puts a bundle on the deployer's list."""
    path = bundle_target(digest)
    deployer.targets[path] = TargetFile(length, {"sha256": digest}, path)


def repository_of(root: Metadata[Root]) -> str:
    """Returns the id of the repository that a root of trust is for.

    Raises:
        TrustRefused: It has none.
    """
    found = root.signed.unrecognized_fields.get(REPOSITORY_FIELD)
    if not isinstance(found, str):
        raise TrustRefused("the root of trust was not made by simyard fleet keys init")
    return found


def read_root(body: bytes) -> Metadata[Root]:
    """Returns root metadata that is signed by its own keys.

    Raises:
        TrustRefused: It is not.
    """
    root = _parse(Root, body, "the root of trust")
    _check("the root of trust", lambda: root.signed.verify_delegate("root", root.signed_bytes, root.signatures))
    return root


def read_published(store: Store, root: Metadata[Root]) -> Published:
    """Returns the newest state of the metadata, each part signed by the key that another part names; expired or not.

    Raises:
        TrustRefused: A part is missing, or is not what was signed.
    """
    repository = repository_of(root)
    root = _newest_root(store, root, repository)
    key = partial(trust_key, repository)
    timestamp = _read_signed(store, Timestamp, key("timestamp.json"), by=root.signed, role="timestamp")
    meta = timestamp.signed.snapshot_meta
    name = f"{meta.version}.snapshot.json"
    snapshot = _read_signed(store, Snapshot, key(name), by=root.signed, role="snapshot", meta=meta)
    meta = _meta(snapshot.signed, "targets.json")
    name = f"{meta.version}.targets.json"
    targets = _read_signed(store, Targets, key(name), by=root.signed, role="targets", meta=meta)
    meta = _meta(snapshot.signed, "deployer.json")
    name = f"{meta.version}.deployer.json"
    deployer = _read_signed(store, Targets, key(name), by=targets.signed, role="deployer", meta=meta)
    return Published(root, targets, deployer, snapshot, timestamp)


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
    body = _sign(root, signers, "root", now)
    name = f"{root.signed.version}.root.json"
    try:
        store.create(trust_key(repository_of(root), name), body)
    except ObjectExists as exc:
        raise TrustRefused(f"another process wrote {name} meanwhile; try again") from exc
    return body


def write(
    store: Store, state: Published, changed: Sequence[Role], signers: Signers, *, now: datetime, claim: Claim
) -> None:
    """Writes the changed parts under new versions, then what refers to them; the last write makes all of it count.

    Args:
        store: Where to.
        state: The state; its parts get their versions, dates and signatures here.
        changed: Those of ``targets`` and ``deployer`` that have to be written.
        signers: Who signs each of the parts that are written, one or more.
        now: The signer's clock.
        claim: This process's claim on the repository.

    Raises:
        TrustRefused: Another process has taken the repository over.
        StoreError: The store fails.
    """
    snapshot, timestamp = state.snapshot.signed, state.timestamp.signed
    for role in changed:
        written = _write_next(store, state, role, signers=signers[role], now=now)
        snapshot.meta[f"{role}.json"] = written
    timestamp.snapshot_meta = _write_next(store, state, "snapshot", signers=signers["snapshot"], now=now)
    timestamp.version += 1
    body = _sign(state.timestamp, signers["timestamp"], "timestamp", now)
    if claim.lost:
        raise TrustRefused("another process has taken over the signing; try again")
    store.put(trust_key(state.repository, "timestamp.json"), body)


def _write_next(
    store: Store, state: Published, role: Role, *, signers: Sequence[CryptoSigner], now: datetime
) -> MetaFile:
    metadata = state.part(role)
    metadata.signed.version += 1
    body = _sign(metadata, signers, role, now)
    store.put(trust_key(state.repository, f"{metadata.signed.version}.{role}.json"), body)
    return MetaFile.from_data(metadata.signed.version, body, ["sha256"])


def _sign(metadata: Part, signers: Sequence[CryptoSigner], role: Role, now: datetime) -> bytes:
    metadata.signed.expires = (now + LIFETIMES[role]).replace(microsecond=0)
    metadata.signatures.clear()
    for signer in signers:
        metadata.sign(signer, append=True)
    return metadata.to_bytes()


def _newest_root(store: Store, root: Metadata[Root], repository: str) -> Metadata[Root]:
    while True:
        name = f"{root.signed.version + 1}.root.json"
        try:
            body = store.get(trust_key(repository, name)).body
        except ObjectNotFound:
            return root
        following = _parse(Root, body, name)
        for by in (root, following):
            _check(name, partial(by.signed.verify_delegate, "root", following.signed_bytes, following.signatures))
        if following.signed.version != root.signed.version + 1 or repository_of(following) != repository:
            raise TrustRefused(f"{name} is another root than its name says")
        root = following


def _read_signed(
    store: Store, kind: type[Kind], key: str, *, by: Root | Targets, role: Role, meta: MetaFile | None = None
) -> Metadata[Kind]:
    name = key.rpartition("/")[2]
    try:
        body = store.get(key).body
    except ObjectNotFound as exc:
        raise TrustRefused(f"{store.url} has no {key}; restore it from a backup") from exc
    if meta:
        _check(name, lambda: meta.verify_length_and_hashes(body))
    found = _parse(kind, body, name)
    _check(name, lambda: by.verify_delegate(role, found.signed_bytes, found.signatures))
    if meta and meta.version != found.signed.version:
        raise TrustRefused(f"{name} has version {found.signed.version}")
    return found


def _parse(kind: type[Kind], body: bytes, name: str) -> Metadata[Kind]:
    try:
        found: Metadata[Kind] = Metadata.from_bytes(body)
    except DeserializationError as exc:
        raise TrustRefused(f"{name} is no metadata: {exc}") from exc
    if found.signed.type != kind.type:
        raise TrustRefused(f"{name} is metadata of {found.signed.type}")
    return found


def _check(name: str, verify: Callable[[], None]) -> None:
    try:
        verify()
    except RepositoryError as exc:
        why = f"{name} is not what was signed: {exc}"
        raise TrustRefused(f"{why}; find out who writes to the store, and restore it from a backup") from exc


def _meta(snapshot: Snapshot, name: str) -> MetaFile:
    if name not in snapshot.meta:
        raise TrustRefused(f"snapshot.json does not name {name}")
    return snapshot.meta[name]
