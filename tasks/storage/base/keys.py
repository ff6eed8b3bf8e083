"""Every key of the store, and the check of what goes into one.

store.json                                  the store's id, written once its promises were probed
tokens/<kind>/<sha256 of the token>.json    which job a clientRequestToken made
jobs/<kind>/<id>.json                       job records
claims/<kind>/<id>.json                     which live process works on a job
templates/<name>.json                       world templates
worlds/<generation>/<world>.json            worlds, immutable
worlds/<generation>/contact-sheet.svg       the first of them side by side, immutable
parts/<export>/<generation>/<world>.zip     files of one world, until the zip of all is written
chunks/<batch>/<number>.json                results of one chunk of lanes, immutable
chunks/<batch>/<number>.started.json        when it was last begun, and how often
results/<batch>/<name>                      tables and evidence of a batch
bundles/<digest>                            application bundles, named by their SHA-256
applications/<kind>/<name>.json             the versions of an application
fleets/<fleet>.json                         fleets
robots/<robot>/record.json                  who the robot is
robots/<robot>/desired.json                 what it shall run; the controller writes
robots/<robot>/reported.json                what it runs; only that robot writes
trust/<repository>/<name>                   signed metadata of bundles and keys; no private key, ever
housekeeping/unnamed.json                   since when bundles have had no name, for the next gc
buckets/<bucket>/...                        what documents call s3Bucket, by default
"""

import hashlib
import re

from specs.base import Fault
from specs.errors import DocumentError

STORE = "store.json"
NAME_RULE = "1 to 64 of A-Z a-z 0-9 _ -, the first a letter or a digit"
KEY_RULE = "parts joined by /, none empty or beginning with a dot, at most 1024 bytes"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,127}")
_BUCKET = re.compile(r"(?!.*\.\.)[a-z0-9][a-z0-9.-]{1,61}[a-z0-9]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")


def checked_key(key: str) -> str:
    """Returns the key, if it is one.

    Raises:
        DocumentError: It could leave the store's folder, or collide with what the store hides there.
    """
    parts = key.split("/")
    if len(key.encode()) > 1024 or _CONTROL.search(key) or any(not part or part.startswith(".") for part in parts):
        raise _refused("key", key, KEY_RULE)
    return key


def checked_name(name: str, what: str = "name") -> str:
    """Returns the name, if it may stand in a key; ``what`` names it in the error.

    Raises:
        DocumentError: It may not.
    """
    return _matched(_NAME, name, what, NAME_RULE)


def checked_bucket(bucket: str) -> str:
    """Returns the bucket's name, if it is one by S3's rules.

    Raises:
        DocumentError: It is not.
    """
    return _matched(_BUCKET, bucket, "s3Bucket", "3 to 63 of a-z 0-9 . -, ends in letters or digits, no two dots")


def output_key(prefix: str | None, name: str) -> str:
    """Returns ``<prefix>/<name>``, for a document's s3Prefix with or without slashes around it, or None."""
    folder = (prefix or "").strip("/")
    return checked_key(f"{folder}/{name}" if folder else name)


def job_key(kind: str, job_id: str) -> str:
    """Returns the key of a job record."""
    return f"{jobs_prefix(kind)}/{checked_name(job_id, 'job')}.json"


def jobs_prefix(kind: str) -> str:
    """Returns the folder that holds the job records of a kind."""
    return f"jobs/{checked_name(kind, 'kind')}"


def token_key(kind: str, token: str) -> str:
    """Returns the key of what a clientRequestToken made; tokens are free text, so the key holds their digest."""
    return f"tokens/{checked_name(kind, 'kind')}/{hashlib.sha256(token.encode()).hexdigest()}.json"


def claim_key(kind: str, job_id: str) -> str:
    """Returns the key under which a process claims a job."""
    return f"claims/{checked_name(kind, 'kind')}/{checked_name(job_id, 'job')}.json"


def template_key(name: str) -> str:
    """Returns the key of a world template."""
    return f"templates/{checked_name(name, 'template')}.json"


def world_key(generation: str, world: str) -> str:
    """Returns the key of a world."""
    return f"{worlds_prefix(generation)}/{checked_name(world, 'world')}.json"


def worlds_prefix(generation: str) -> str:
    """Returns the folder that holds the worlds of a generation job."""
    return f"worlds/{checked_name(generation, 'generation')}"


def contact_sheet_key(generation: str) -> str:
    """Returns the key of the sheet that shows the worlds of a generation job."""
    return f"{worlds_prefix(generation)}/contact-sheet.svg"


def export_part_key(export: str, generation: str, world: str) -> str:
    """Returns the key of what a worker made of one world for an export job."""
    return f"{export_parts_prefix(export)}/{checked_name(generation, 'generation')}/{checked_name(world, 'world')}.zip"


def export_parts_prefix(export: str) -> str:
    """Returns the folder that holds what workers made for an export job."""
    return f"parts/{checked_name(export, 'export')}"


def chunk_key(batch: str, number: int) -> str:
    """Returns the key of the results of a batch's chunk."""
    return f"{chunks_prefix(batch)}/{number:06d}.json"


def chunk_start_key(batch: str, number: int) -> str:
    """Returns the key of when a batch's chunk was begun."""
    return f"{chunks_prefix(batch)}/{number:06d}.started.json"


def chunks_prefix(batch: str) -> str:
    """Returns the folder that holds the chunks of a batch."""
    return f"chunks/{checked_name(batch, 'batch')}"


def result_key(batch: str, name: str) -> str:
    """Returns the key of one of a batch's files, such as ``evidence.json``."""
    return f"results/{checked_name(batch, 'batch')}/{_matched(_FILE, name, 'file', 'a plain file name')}"


def bundle_key(digest: str) -> str:
    """Returns the key of an application bundle."""
    return f"bundles/{_matched(_DIGEST, digest, 'digest', '64 lower-case hex digits')}"


def application_key(kind: str, name: str) -> str:
    """Returns the key of an application's versions."""
    return f"{applications_prefix(kind)}/{checked_name(name, 'application')}.json"


def applications_prefix(kind: str) -> str:
    """Returns the folder that holds the applications of a kind."""
    return f"applications/{checked_name(kind, 'kind')}"


def fleet_key(fleet: str) -> str:
    """Returns the key of a fleet."""
    return f"fleets/{checked_name(fleet, 'fleet')}.json"


def robot_record_key(robot: str) -> str:
    """Returns the key of a robot's record."""
    return f"robots/{checked_name(robot, 'robot')}/record.json"


def desired_key(robot: str) -> str:
    """Returns the key of what a robot shall run."""
    return f"robots/{checked_name(robot, 'robot')}/desired.json"


def reported_key(robot: str) -> str:
    """Returns the key of what a robot says it runs."""
    return f"robots/{checked_name(robot, 'robot')}/reported.json"


def trust_key(repository: str, name: str) -> str:
    """Returns the key of one of a repository's signed files, such as ``timestamp.json``."""
    return f"trust/{checked_name(repository, 'repository')}/{_matched(_FILE, name, 'file', 'a plain file name')}"


def _matched(pattern: re.Pattern[str], text: str, what: str, rule: str) -> str:
    if not pattern.fullmatch(text):
        raise _refused(what, text, rule)
    return text


def _refused(what: str, text: str, rule: str) -> DocumentError:
    return DocumentError([Fault(path=what, value=repr(text[:80]), allowed=rule)], source="store")
