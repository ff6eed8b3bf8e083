"""What an object of a store is, from its key alone, and which job it belongs to."""

import re
from dataclasses import dataclass
from typing import cast

from tasks.storage.jobs.records import JobKind

NOTES = "housekeeping/unnamed.json"
"""Since when each bundle has been without a name, for the next time that somebody asks."""

RECORD_FOLDERS = ("jobs", "applications", "robots", "fleets", "results")
"""Where objects lie that name others; of ``results`` the evidence alone."""

WORLDS, EXPORTS, RESULTS, RECORDINGS, BUNDLES = "worlds", "exports", "results", "recordings", "bundles"
CHUNKS, PARTS, NOTES_OF_BATCHES = "chunks", "export parts", "audit notes"
TOKENS, CLAIMS, RECORDS, PROBES = "tokens", "claims", "job records", "probes"
METADATA, UNFINISHED = "signed metadata", "unfinished writes"

NAMED_BY_OTHERS = frozenset({WORLDS, EXPORTS, RESULTS, RECORDINGS, BUNDLES})
"""What records of other jobs than its own may name."""

NEEDS_PROOF = frozenset({WORLDS, EXPORTS, RESULTS, RECORDINGS})
"""What may come from elsewhere too, as a world that somebody added: only what a job of this store made is freed."""

_PREFIXES: dict[str, JobKind] = {
    "wgj": "world-generation-job",
    "wej": "world-export-job",
    "simb": "simulation-job-batch",
    "dep": "deployment-job",
    "run": "pipeline-run",
}
_KINDS = frozenset(_PREFIXES.values())
_ID = r"(?:wgj|wej|simb|dep|run)-[0-9a-f]{16}"
_EVIDENCE = re.compile(rf"results/({_ID})/evidence\.json")
_PLACES: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(rf"worlds/({_ID})/[^/]+\.(?:json|svg)"), WORLDS),
    (re.compile(rf"parts/({_ID})/.+"), PARTS),
    (re.compile(rf"chunks/({_ID})/\d+(?:\.started)?\.json"), CHUNKS),
    (re.compile(rf"results/({_ID})/audit-begun\.json"), NOTES_OF_BATCHES),
    (re.compile(rf"claims/[a-z-]+/({_ID})\.json"), CLAIMS),
    (re.compile(rf"jobs/[a-z-]+/({_ID})\.json"), RECORDS),
    (re.compile(rf"buckets/(?:.+/)?recordings/({_ID})/\d+\.parquet"), RECORDINGS),
    (re.compile(rf"buckets/(?:.+/)?({_ID})/(?:(?:results|failures)\.parquet|report\.html|audit\.json)"), RESULTS),
    (re.compile(rf"buckets/(?:.+/)?({_ID})(?:\.zip|(?:/[^/]+){{1,2}}\.svg)"), EXPORTS),
)
_BUNDLE = re.compile(r"bundles/([0-9a-f]{64})")
_METADATA = re.compile(r"trust/([^/]+)/(\d+)\.(targets|deployer|snapshot)\.json")


@dataclass(frozen=True)
class Job:
    """A job, whether its record is there or not."""

    kind: JobKind
    id: str


@dataclass(frozen=True)
class Place:
    """What an object is.

    Attributes:
        what: One of this module's kinds, or empty for what housekeeping never touches.
        job: Whose it is; None for what is no job's.
    """

    what: str
    job: Job | None = None


def place_of(key: str) -> Place:
    """Returns what the object under a key is; of a token only that it is one."""
    for pattern, what in _PLACES:
        if found := pattern.fullmatch(key):
            return Place(what, job_named(found[1]))
    if _BUNDLE.fullmatch(key):
        return Place(BUNDLES)
    if key.startswith("tokens/") and key.split("/")[1] in _KINDS:
        return Place(TOKENS)
    if _METADATA.fullmatch(key):
        return Place(METADATA)
    return Place(PROBES if re.fullmatch(r"probe/[0-9a-f]{32}", key) else "")


def job_named(job_id: str) -> Job:
    """Returns the job with an id such as ``simb-0123456789abcdef``."""
    return Job(_PREFIXES[job_id.partition("-")[0]], job_id)


def is_record(key: str) -> bool:
    """Returns whether the object may name others."""
    folder = key.partition("/")[0]
    return folder in RECORD_FOLDERS and (folder != "results" or _EVIDENCE.fullmatch(key) is not None)


def ids_in(text: str) -> frozenset[str]:
    """Returns the ids of all jobs that stand anywhere in a text."""
    return frozenset(cast("list[str]", re.findall(rf"(?<![0-9A-Za-z]){_ID}(?![0-9a-z])", text)))


def digests_in(text: str) -> frozenset[str]:
    """Returns all SHA-256 digests that stand anywhere in a text, of bundles and of anything else."""
    return frozenset(cast("list[str]", re.findall(r"(?<![0-9A-Za-z])[0-9a-f]{64}(?![0-9A-Za-z])", text)))


def metadata_version(key: str) -> tuple[str, str, int]:
    """Returns the repository, the role and the version of signed metadata."""
    found = cast("re.Match[str]", _METADATA.fullmatch(key))
    return found[1], found[3], int(found[2])
