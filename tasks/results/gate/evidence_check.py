"""Checks, right before a bundle is shipped, that everything the evidence names still has the same bytes."""

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from specs.errors import ObjectNotFound
from specs.field_types import OutputLocation
from tasks.results.gate.evidence import EVIDENCE_FILE, Evidence
from tasks.results.gate.shipped_builds import Shipment, shipment_changes
from tasks.results.tables.result_files import RESULTS_FILE
from tasks.storage.base.keys import bundle_key, output_key, result_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.worlds import reference_key

Locate = Callable[[str], OutputLocation]


def evidence_faults(
    store: Store, batch: str, pinned: str, shipped: str, locate: Locate, *, ships: Shipment | None = None
) -> list[str]:
    """Returns what is not as it was when the gate passed, one line each, naming the object; nothing if all is.

    Hashed again are the evidence itself, the bundles of all applications that took part, each world's document, the
    batch's result files, and those of the batch that it was compared with. Evidence that is not the one that was
    written says nothing about the rest.

    Args:
        store: Where everything is.
        batch: Id of the batch that the evidence is about.
        pinned: SHA-256 of the evidence, as the run's record has it.
        shipped: SHA-256 of the bundle that is to be shipped.
        locate: Gives a batch's output location.
        ships: What is to be shipped, build by build.
    """
    key = result_key(batch, EVIDENCE_FILE)
    try:
        body = store.get(key).body
    except ObjectNotFound:
        return [f"{key} is gone; the gate wrote it with the SHA-256 {pinned}"]
    found = hashlib.sha256(body).hexdigest()
    if found != pinned:
        return [_change_text(key, found, pinned)]
    evidence = Evidence.model_validate_json(body)
    return [
        *_robot_faults(evidence, shipped),
        *shipment_changes(evidence, ships),
        *_file_faults(store, evidence, locate),
    ]


def _robot_faults(evidence: Evidence, shipped: str) -> Iterator[str]:
    if evidence.verdict != "PASS":
        yield f"the evidence of {evidence.batch} says {evidence.verdict}"
    judged = evidence.judged_robots()
    if shipped not in {robot.digest for robot in judged}:
        names = ", ".join(f"{robot.name} version {robot.version} ({robot.digest})" for robot in judged)
        yield f"the bundle that is to be shipped is {shipped}; the evidence of {evidence.batch} is about {names}"


def _file_faults(store: Store, evidence: Evidence, locate: Locate) -> Iterator[str]:
    for use in (*evidence.robots, *evidence.simulations):
        what = f"bundle of {use.name} version {use.version}, {bundle_key(use.digest)},"
        yield from _object_faults(store, bundle_key(use.digest), use.digest, what)
    for name, digest in evidence.worlds.items():
        key = reference_key(name)
        yield from _object_faults(store, key, digest, f"world {name}, {key},")
    files = [(evidence.batch, name, digest) for name, digest in evidence.files.items()]
    if evidence.baseline and evidence.baseline.batch != evidence.batch:
        files.append((evidence.baseline.batch, RESULTS_FILE, evidence.baseline.sha256))
    for batch, name, digest in files:
        place = locate(batch)
        bucket = open_bucket(store, place.s3Bucket or "")
        key = output_key(place.s3Prefix, f"{batch}/{name}")
        yield from _object_faults(bucket, key, digest, f"result file {bucket.url}/{key}")


def _object_faults(store: Store, key: str, digest: str, what: str) -> Iterator[str]:
    """Yields what is wrong with an object, if its bytes are not those of the digest."""
    with tempfile.TemporaryDirectory(prefix="simyard-evidence-") as folder:
        copy = Path(folder) / "object"
        try:
            store.download(key, copy)
        except ObjectNotFound:
            yield f"{what} is gone"
            return
        with copy.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != digest:
        yield _change_text(what, found, digest)


def _change_text(what: str, found: str, digest: str) -> str:
    return f"{what} has changed: its SHA-256 is {found}; judged was {digest}"
