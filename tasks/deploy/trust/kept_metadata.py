"""The owner's copy of the newest metadata, in the folder of keys: what the store shows must not be older.

A writer keeps the copy before the last of its writes. So whoever comes after one that was killed finishes its work, and
whoever finds an older state than the copy knows that somebody has put it back.
"""

from collections.abc import Mapping
from contextlib import suppress

from specs.errors import ObjectNotFound, ObjectTooBig, TrustRefused
from tasks.deploy.trust.keyring import KeptMetadata, Keyring, SignerNotes, refused_keys
from tasks.deploy.trust.metadata import MOST_METADATA_BYTES, Published, part_name, read_published, read_root
from tasks.deploy.trust.tuf_names import DeserializationError, Metadata, Timestamp
from tasks.storage.base.keys import claim_key, trust_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim

KIND = "trust"
"""Of the claim on a repository."""
_NEWEST = part_name("timestamp", 0)


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
