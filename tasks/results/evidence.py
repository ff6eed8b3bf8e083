"""Evidence: what was judged, by which rule, with which answer, named by digests to be held against a bundle.

It holds no time and no place: the same pipeline gives the same evidence, byte for byte, on any store and at any hour.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

from specs.base import Spec
from specs.digests import canonical_document, canonical_json
from specs.episode import ApplicationLaunch, EpisodeRequest
from specs.pipeline_simulation import SuccessRate
from specs.report import Verdict as Answer
from tasks.results.gate import GateNumbers, Verdict
from tasks.storage.keys import result_key
from tasks.storage.store import Store

EVIDENCE_FILE = "evidence.json"
EVIDENCE_VERSION = "1"


class ApplicationEvidence(Spec):
    """An application that took part: its name, the version asked for, and the SHA-256 of what really ran."""

    name: str
    version: str
    digest: str


class Evidence(Spec):
    """What a roll-out may rest on.

    Attributes:
        batch: Id of the simulation job batch.
        robots: Robot applications, one in the usual case.
        simulations: Simulation applications.
        worlds: SHA-256 of each world's document, by ``<generation>/<name>``.
        seeds: All seeds, sorted.
        environments: The values each environment variable took, sorted.
        engine: What simulated, such as ``mjx``.
        versions: Versions of what the numbers depend on, by package.
        files: SHA-256 of each result file, by its name.
    """

    version: Literal["1"] = EVIDENCE_VERSION
    batch: str
    verdict: Answer
    sentence: str
    rule: SuccessRate
    numbers: GateNumbers
    robots: tuple[ApplicationEvidence, ...]
    simulations: tuple[ApplicationEvidence, ...]
    worlds: dict[str, str]
    seeds: tuple[int, ...]
    environments: dict[str, tuple[str, ...]]
    engine: str
    versions: dict[str, str]
    files: dict[str, str]


def gather(
    batch_id: str,
    requests: Sequence[EpisodeRequest],
    rule: SuccessRate,
    verdict: Verdict,
    *,
    worlds: Mapping[str, str],
    engine: str,
    versions: Mapping[str, str],
    files: Mapping[str, str],
) -> Evidence:
    """Returns the evidence for a verdict.

    Args:
        batch_id: The batch.
        requests: All its episodes.
        rule: What was asked for.
        verdict: What the gate answered.
        worlds: SHA-256 of each world's bytes in the store, by ``<generation>/<name>``; others than the batch's are
            left out.
        engine: What simulated.
        versions: Of Simyard and what its numbers depend on.
        files: SHA-256 of the result files by name.

    Raises:
        ValueError: A world of the batch has no digest.
    """
    used = {request.world for request in requests}
    if missing := sorted(used - worlds.keys()):
        raise ValueError(f"no digest for {', '.join(missing[:5])}")
    return Evidence(
        batch=batch_id,
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        rule=rule,
        numbers=verdict.numbers,
        robots=_applications(request.robot for request in requests),
        simulations=_applications(request.scenario for request in requests),
        worlds={name: worlds[name] for name in sorted(used)},
        seeds=tuple(sorted({request.seed for request in requests})),
        environments=_environments(requests),
        engine=engine,
        versions=dict(versions),
        files=dict(files),
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
    found = {(launch.name, launch.version, launch.digest) for launch in launches}
    return tuple(
        ApplicationEvidence(name=name, version=version, digest=digest) for name, version, digest in sorted(found)
    )


def _environments(requests: Sequence[EpisodeRequest]) -> dict[str, tuple[str, ...]]:
    values: dict[str, set[str]] = {}
    for request in requests:
        for name, value in request.environment.items():
            values.setdefault(name, set()).add(value)
    return {name: tuple(sorted(values[name])) for name in sorted(values)}
