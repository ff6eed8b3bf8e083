"""The evidence of a verdict: what was judged, by which rules, with which answer, all named by digests.

It holds no time and no place: the same pipeline gives the same evidence, byte for byte, at any hour and on any store in
which its gate was tried as often. Right before a bundle is shipped it is checked that everything that the evidence
names still has the same bytes.

A judgement that was made after a batch's run has evidence of a form of its own, kept beside that of the run and never
shipped by: a rule that is chosen after the numbers were seen can be chosen so that they pass. The check before a
deployment does not read it, and it says by itself what it is (docs/decisions/0014).
"""

import hashlib
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Literal

from specs.base import Spec, canonical_document, canonical_json
from specs.data.episode import ApplicationLaunch
from specs.data.run_report import Verdict
from specs.errors import ObjectNotFound
from specs.field_types import Architecture, OutputLocation
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import GateVerdict
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.gate.shipped_builds import Shipment, shipment_lines
from tasks.results.statistics.batch_summary import EpisodeCounts
from tasks.results.statistics.room_coverage import RoomCoverage
from tasks.results.tables.result_files import RESULTS_FILE
from tasks.storage.base.keys import bundle_key, output_key, result_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.worlds import reference_key

EVIDENCE_FILE = "evidence.json"
EVIDENCE_VERSION = "6"
_RAN_ON = frozenset({"engine", "device", "lanes"})


class ApplicationEvidence(Spec):
    """An application that took part: its name, the version asked for, and the SHA-256 of what really ran.

    Attributes:
        architecture: Which of the version's builds that is; None where one is for all of them.
    """

    name: str
    version: str
    digest: str
    architecture: Architecture | None = None


class TestedBatch(Spec):
    """What a batch tested, and with what.

    Attributes:
        robots: Robot applications, one in the usual case.
        simulations: Simulation applications.
        worlds: SHA-256 of each world's document, by ``<generation>/<name>``; of the batch's worlds and no others.
        seeds: All seeds, sorted.
        environments: The values each environment variable took, sorted.
        engine: What simulated, such as ``planar``.
        device: The kind of device that it simulated on.
        lanes: Episodes of a chunk.
        versions: Versions of what the numbers depend on, by package.
        files: SHA-256 of each result file, by its name.
    """

    robots: tuple[ApplicationEvidence, ...]
    simulations: tuple[ApplicationEvidence, ...]
    worlds: dict[str, str]
    seeds: tuple[int, ...]
    environments: dict[str, tuple[str, ...]]
    engine: str
    device: str
    lanes: int
    versions: dict[str, str]
    files: dict[str, str]


class Baseline(Spec):
    """The other version that a gate compared with, and where its episodes are.

    Attributes:
        version: Its number.
        digest: SHA-256 of its bundle.
        batch: Id of the batch that drove it; the judged one itself if that has both versions.
        sha256: SHA-256 of that batch's ``results.parquet``.
    """

    version: str
    digest: str
    batch: str
    sha256: str


class Evidence(TestedBatch):
    """What a roll-out may rest on.

    Attributes:
        batch: Id of the simulation job batch.
        rule: What the document asked for.
        verdict: The gate's answer.
        sentence: Why, for a person.
        numbers: What the judged episodes came to.
        rules: The answer of each rule, with its numbers.
        left_out: Episodes that were not needed any more, because the gate was certain.
        baseline: The version that ``noWorseThan`` compared with; it is in ``robots`` too if the batch drove it, and the
            verdict is not about it.
        ships: What the document ships; None where it deploys nothing.
        rooms: How much of its worlds the robots were in; None where nothing says that.
        tries: How often the gate was asked before of the same version on other episodes, and did not say PASS.
    """

    version: Literal["6"] = EVIDENCE_VERSION
    batch: str
    verdict: Verdict
    sentence: str
    rule: Gate
    numbers: EpisodeCounts
    rules: tuple[RuleVerdict, ...]
    left_out: int = 0
    baseline: Baseline | None = None
    ships: Shipment | None = None
    rooms: RoomCoverage | None = None
    tries: int = 0

    def judged_robots(self) -> tuple[ApplicationEvidence, ...]:
        """Returns the robot applications that the verdict is about."""
        if self.baseline is None or self.baseline.batch != self.batch:
            return self.robots
        return tuple(robot for robot in self.robots if robot.digest != self.baseline.digest)


def tested_batch(
    *,
    robots: Iterable[ApplicationLaunch],
    simulations: Iterable[ApplicationLaunch],
    worlds: Mapping[str, str],
    seeds: Iterable[int],
    variables: Mapping[str, Iterable[str | None]],
    metadata: Mapping[str, str],
    files: Mapping[str, str],
) -> TestedBatch:
    """Returns what a batch tested, in the one order that equal batches share.

    Args:
        robots: Robot applications as the batch launched them, in any order and number.
        simulations: Simulation applications, likewise.
        worlds: SHA-256 of each world's bytes in the store, by ``<generation>/<name>``.
        seeds: The seeds.
        variables: The values that each environment variable took; None where it was not set.
        metadata: ``engine``, ``device`` and ``lanes``, and versions by package.
        files: SHA-256 of the result files by name.
    """
    return TestedBatch(
        robots=_applications(robots),
        simulations=_applications(simulations),
        worlds={name: worlds[name] for name in sorted(worlds)},
        seeds=tuple(sorted(set(seeds))),
        environments={
            name: tuple(sorted({value for value in variables[name] if value is not None})) for name in sorted(variables)
        },
        engine=metadata["engine"],
        device=metadata["device"],
        lanes=int(metadata["lanes"]),
        versions={name: version for name, version in metadata.items() if name not in _RAN_ON},
        files=dict(files),
    )


def gather(
    batch_id: str,
    gate: Gate,
    verdict: GateVerdict,
    facts: TestedBatch,
    *,
    left_out: int = 0,
    baseline: Baseline | None = None,
    ships: Shipment | None = None,
) -> Evidence:
    """Returns the evidence for a verdict.

    Args:
        batch_id: The batch.
        gate: What was asked for.
        verdict: What the gate answered.
        facts: What was tested.
        left_out: Episodes that were not needed any more.
        baseline: What the gate compared with, if it did.
        ships: What the document ships, if it deploys.
    """
    return Evidence(
        **facts.model_dump(),
        batch=batch_id,
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        rule=gate,
        numbers=verdict.counts,
        rules=verdict.rules,
        left_out=left_out,
        baseline=baseline,
        ships=ships,
        rooms=verdict.rooms,
        tries=len(verdict.attempts),
    )


def encode_evidence(evidence: Evidence) -> bytes:
    """Returns the evidence as canonical JSON."""
    return canonical_json(canonical_document(evidence))


def evidence_digest(evidence: Evidence) -> str:
    """Returns the SHA-256 of the encoded evidence: its name wherever it is referred to."""
    return hashlib.sha256(encode_evidence(evidence)).hexdigest()


def write_evidence(store: Store, evidence: Evidence) -> str:
    """Writes the evidence beside the batch's record and returns its URL; the same evidence again changes nothing."""
    key = result_key(evidence.batch, EVIDENCE_FILE)
    store.put(key, encode_evidence(evidence))
    return f"{store.url}/{key}"


def read_evidence(store: Store, batch_id: str) -> Evidence:
    """Returns the evidence of a batch.

    Raises:
        ObjectNotFound: The batch was not judged.
        ValidationError: It is not evidence that this version wrote.
    """
    return Evidence.model_validate_json(store.get(result_key(batch_id, EVIDENCE_FILE)).body)


def _applications(launches: Iterable[ApplicationLaunch]) -> tuple[ApplicationEvidence, ...]:
    found = {(launch.name, launch.version, launch.digest, launch.architecture or "") for launch in launches}
    return tuple(
        ApplicationEvidence.model_validate(
            {"name": name, "version": version, "digest": digest, "architecture": architecture or None}
        )
        for name, version, digest, architecture in sorted(found)
    )


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


def shipment_changes(evidence: Evidence, ships: Shipment | None) -> Iterator[str]:
    """Yields what is to be shipped and is not what the evidence says, a line each.

    Args:
        evidence: What the gate judged.
        ships: What is to be shipped; None where nobody settled it.
    """
    if ships is None:
        return
    if evidence.ships != ships:
        found = "; ".join(shipment_lines(evidence.ships)) if evidence.ships else "nothing"
        yield f"to be shipped is {'; '.join(shipment_lines(ships))}; the evidence of {evidence.batch} names {found}"
    judged = {robot.digest for robot in evidence.judged_robots()}
    tested = {build.architecture for build in ships.builds if build.digest in judged}
    for build in ships.builds:
        if build.digest not in judged and build.tested_as not in tested:
            yield f"the build for {build.architecture}, {build.digest}, is not one that the gate judged"
    for name, value in ships.variables.items():
        if value not in evidence.environments.get(name, ()):
            yield f"variable {name} is to be {value!r} on robots, which no episode of {evidence.batch} had"


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


_LATER_NOTICE = "Judged after the batch had ended and its numbers could be seen. It authorises no deployment."
_LATER_DIGITS = 16


class LaterEvidence(Spec):
    """What a batch came to under the rules of another document, or of the same one again.

    Attributes:
        notice: What this is, for a person.
        document: SHA-256 of the document whose gate was asked.
        vouched: Whether the owner's key vouches for what the batch's record says.
        judged: What was judged, by which rules, with which answers; it ships nothing.
    """

    kind: Literal["later judgement"] = "later judgement"
    version: Literal["1"] = "1"
    notice: str = _LATER_NOTICE
    document: str
    vouched: bool
    judged: Evidence


class WrittenEvidence(Spec):
    """Where evidence lies, and its SHA-256."""

    url: str
    sha256: str


def write_later_evidence(store: Store, evidence: LaterEvidence) -> WrittenEvidence:
    """Writes the evidence under a name made of its content, so that nothing is ever overwritten by another."""
    body = canonical_json(canonical_document(evidence))
    digest = hashlib.sha256(body).hexdigest()
    key = result_key(evidence.judged.batch, f"later-{digest[:_LATER_DIGITS]}.json")
    store.put(key, body)
    return WrittenEvidence(url=f"{store.url}/{key}", sha256=digest)
