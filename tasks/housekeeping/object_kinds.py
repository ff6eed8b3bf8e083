"""What an object of a store is, from its key alone, and which job it belongs to."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

from specs.job_kinds import JOB_KINDS, JobDeclaration, JobKind
from tasks.storage.base.keys import BUNDLE, CLAIM, JOB, TOKEN, TRUST, key_pattern

RECORD_FOLDERS = ("jobs", "applications", "robots", "fleets", "results")
"""Where objects lie that name others; of ``results`` the evidence alone."""

WORLDS, BUNDLES = "worlds", "bundles"
TOKENS, CLAIMS, RECORDS, PROBES = "tokens", "claims", "job records", "probes"
METADATA, UNFINISHED = "signed metadata", "unfinished writes"

_OBJECTS = [each for kind in JOB_KINDS.values() for each in kind.objects]
NEEDS_PROOF = frozenset(each.what for each in _OBJECTS if each.from_elsewhere)
"""What may come from elsewhere too, as a world that somebody added: only what a job of this store made is freed."""

NAMED_BY_OTHERS = NEEDS_PROOF | {BUNDLES}
"""What records of other jobs than its own may name."""

SPENT = {each.what: each.spent for each in _OBJECTS if each.spent}
"""What goes as soon as its job has ended, and why."""

_KINDS: dict[str, JobKind] = {each.prefix: each.kind for each in JOB_KINDS.values()}
_ID = rf"(?:{'|'.join(_KINDS)})-[0-9a-f]{{16}}"
_BUCKETS = re.compile(r"buckets/(?:.+/)?")


def _patterns(kind: JobDeclaration) -> Iterator[tuple[re.Pattern[str], str, str]]:
    """Yields what matches the keys of a kind's objects, the part that is the job's id, and what the objects are."""
    for each in kind.objects:
        for form in each.forms:
            inner = key_pattern(form, **{kind.part: _ID}).pattern
            yield re.compile(f"{_BUCKETS.pattern}{inner}" if each.in_bucket else inner), kind.part, each.what


_PLACES: tuple[tuple[re.Pattern[str], str, str], ...] = (
    (key_pattern(CLAIM, job=_ID), "job", CLAIMS),
    (key_pattern(JOB, job=_ID), "job", RECORDS),
    *(place for kind in JOB_KINDS.values() for place in _patterns(kind)),
)
_EVIDENCE = re.compile(rf"results/({_ID})/evidence\.json")
_BUNDLE = key_pattern(BUNDLE)
_TOKEN = key_pattern(TOKEN, kind="|".join(JOB_KINDS))
_METADATA = key_pattern(TRUST, file=r"(?P<version>\d+)\.(?P<role>targets|deployer|snapshot)\.json")
_PROBE = re.compile(r"probe/[0-9a-f]{32}")


@dataclass(frozen=True)
class StoredJob:
    """A job, whether its record is there or not."""

    kind: JobKind
    id: str


@dataclass(frozen=True)
class ObjectKind:
    """What an object is.

    Attributes:
        what: One of this module's kinds, or empty for what housekeeping never touches.
        job: Whose it is; None for what is no job's.
    """

    what: str
    job: StoredJob | None = None


def kind_of_key(key: str) -> ObjectKind:
    """Returns what the object under a key is; of a token only that it is one."""
    for pattern, part, what in _PLACES:
        if found := pattern.fullmatch(key):
            return ObjectKind(what, job_of_id(found[part]))
    others = (
        (_BUNDLE, BUNDLES),
        (_TOKEN, TOKENS),
        (_METADATA, METADATA),
        (_PROBE, PROBES),
    )
    return ObjectKind(next((what for pattern, what in others if pattern.fullmatch(key)), ""))


def job_of_id(job_id: str) -> StoredJob:
    """Returns the job with an id such as ``simb-0123456789abcdef``."""
    return StoredJob(_KINDS[job_id.partition("-")[0]], job_id)


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
    return found["repository"], found["role"], int(found["version"])
