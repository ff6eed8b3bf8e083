"""The signed metadata of one repository in the store: what it is, and how it is read and checked.

``trust/<repository>/``: ``<n>.root.json``, ``<n>.targets.json``, ``<n>.deployer.json``, ``<n>.snapshot.json`` and
``timestamp.json``. All but the last are written once under their version; the last names the versions that count, so
writing it is the one moment at which anything changes. Killed before, a writer has changed nothing (TUF specification
1.0.33, sections 6 and 7.1).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from typing import TypeVar

from specs.errors import ObjectNotFound, ObjectTooBig, TrustRefused
from tasks.deploy.trust.keyring import (
    CryptoSigner,
    DelegatedRole,
    Delegations,
    DeserializationError,
    Metadata,
    MetaFile,
    RepositoryError,
    Role,
    Root,
    Snapshot,
    TargetFile,
    Targets,
    Timestamp,
)
from tasks.storage.base.keys import trust_key
from tasks.storage.base.store import Store

REPOSITORY_FIELD = "x-simyard-repository"
MOST_METADATA_BYTES = 5_000_000
"""Of any file; the updater on a robot holds each kind to less."""
_BUNDLES = "bundles/*"
_RESTORE = "restore it from a backup, or from these keys: simyard fleet keys restore"
Part = Metadata[Root] | Metadata[Targets] | Metadata[Snapshot] | Metadata[Timestamp]
Kind = TypeVar("Kind", Root, Targets, Snapshot, Timestamp)


@dataclass(frozen=True)
class Published:
    """One consistent state of the metadata; what it holds is changed in place before it is written again.

    Attributes:
        bodies: The file name and the bytes of each part but root, as they were read or written last.
    """

    root: Metadata[Root]
    targets: Metadata[Targets]
    deployer: Metadata[Targets]
    snapshot: Metadata[Snapshot]
    timestamp: Metadata[Timestamp]
    bodies: dict[Role, tuple[str, bytes]] = field(default_factory=dict[Role, tuple[str, bytes]])

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
    root = _newest_root(store, root, repository_of(root))
    read = _Reader(store, repository_of(root))
    timestamp = read.part(Timestamp, "timestamp", by=root.signed)
    snapshot = read.part(Snapshot, "snapshot", by=root.signed, meta=timestamp.signed.snapshot_meta)
    targets = read.part(Targets, "targets", by=root.signed, meta=_meta(snapshot.signed, "targets.json"))
    deployer = read.part(Targets, "deployer", by=targets.signed, meta=_meta(snapshot.signed, "deployer.json"))
    return Published(root, targets, deployer, snapshot, timestamp, read.bodies)


def part_name(role: Role, version: int) -> str:
    """Returns the file name of a role's metadata of that version."""
    return "timestamp.json" if role == "timestamp" else f"{version}.{role}.json"


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


class _Reader:
    """Reads and checks the parts of a repository, and keeps their bytes."""

    def __init__(self, store: Store, repository: str) -> None:
        self.bodies: dict[Role, tuple[str, bytes]] = {}
        self._store = store
        self._repository = repository

    def part(self, kind: type[Kind], role: Role, *, by: Root | Targets, meta: MetaFile | None = None) -> Metadata[Kind]:
        name = part_name(role, meta.version if meta else 0)
        body = self._body(name)
        if meta:
            _check(name, lambda: meta.verify_length_and_hashes(body))
        found = _parse(kind, body, name)
        _check(name, lambda: by.verify_delegate(role, found.signed_bytes, found.signatures))
        if meta and meta.version != found.signed.version:
            raise TrustRefused(f"{name} has version {found.signed.version}")
        self.bodies[role] = (name, body)
        return found

    def _body(self, name: str) -> bytes:
        key = trust_key(self._repository, name)
        try:
            return self._store.get(key, MOST_METADATA_BYTES).body
        except ObjectNotFound as exc:
            raise TrustRefused(f"{self._store.url} has no {key}; {_RESTORE}") from exc
        except ObjectTooBig as exc:
            raise TrustRefused(f"{exc}; {_RESTORE}") from exc


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
        raise TrustRefused(f"{why}; find out who writes to the store, and {_RESTORE}") from exc


def _meta(snapshot: Snapshot, name: str) -> MetaFile:
    if name not in snapshot.meta:
        raise TrustRefused(f"snapshot.json does not name {name}")
    return snapshot.meta[name]
