"""Writes the signed metadata of a repository, in an order in which robots can verify it at every moment.

The owner keeps a copy of the new state before the last write makes it count (`tasks.deploy.trust.kept_metadata`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from specs.errors import ObjectExists, TrustRefused
from tasks.deploy.trust.keyring import Role
from tasks.deploy.trust.metadata import MOST_METADATA_BYTES, Part, Published, part_name, repository_of
from tasks.deploy.trust.tuf_names import CryptoSigner, Metadata, MetaFile, Root
from tasks.storage.base.keys import trust_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim

# How long a stolen key, or a store that shows nothing new, can go unnoticed at most; each has its own cost of renewal.
LIFETIMES: Mapping[Role, timedelta] = {
    "root": timedelta(days=730),
    "targets": timedelta(days=365),
    "deployer": timedelta(days=90),
    "snapshot": timedelta(days=30),
    "timestamp": timedelta(days=1),
}
Signers = Mapping[Role, Sequence[CryptoSigner]]


@dataclass(frozen=True)
class Pen:
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


def write(store: Store, state: Published, changed: Sequence[Role], pen: Pen) -> None:
    """Writes the changed parts under new versions, then what refers to them; the last write makes all of it count.

    Args:
        store: Where to.
        state: The state; its parts get their versions, dates and signatures here.
        changed: Those of ``targets``, ``deployer`` and ``snapshot`` that have to be written; the snapshot always is
            with one of the others.
        pen: What it is written with.

    Raises:
        TrustRefused: Another process has taken the repository over, or a part is larger than robots read.
        StoreError: The store fails.
    """
    snapshot, timestamp = state.snapshot.signed, state.timestamp.signed
    for role in changed:
        if role != "snapshot":
            snapshot.meta[f"{role}.json"] = _write_next(store, state, role, pen)
    if changed:
        timestamp.snapshot_meta = _write_next(store, state, "snapshot", pen)
    timestamp.version += 1
    body = _sign(state.timestamp, "timestamp", pen)
    if pen.claim.lost:
        raise TrustRefused("another process has taken over the signing; try again")
    state.bodies["timestamp"] = (part_name("timestamp", timestamp.version), body)
    pen.keep(timestamp.version, dict(state.bodies.values()))
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


def _write_next(store: Store, state: Published, role: Role, pen: Pen) -> MetaFile:
    metadata = state.part(role)
    metadata.signed.version += 1
    body = _sign(metadata, role, pen)
    name = part_name(role, metadata.signed.version)
    if len(body) > MOST_METADATA_BYTES:
        what = f"{name} would have {len(body)} bytes, and robots read {MOST_METADATA_BYTES} at most"
        raise TrustRefused(f"{what}: divide the robots among several stores, each with its keys")
    store.put(trust_key(state.repository, name), body)
    state.bodies[role] = (name, body)
    return MetaFile.from_data(metadata.signed.version, body, ["sha256"])


def _sign(metadata: Part, role: Role, pen: Pen) -> bytes:
    return _signed(metadata, pen.signers[role], pen.now + pen.lifetimes[role])


def _signed(metadata: Part, signers: Sequence[CryptoSigner], expires: datetime) -> bytes:
    metadata.signed.expires = expires.replace(microsecond=0)
    metadata.signatures.clear()
    for signer in signers:
        metadata.sign(signer, append=True)
    return metadata.to_bytes()
