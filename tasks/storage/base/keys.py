"""Every key of the store: its form, and how it is filled.

The forms of what jobs keep stand with the kinds of jobs (specs.job_kinds); buckets/<bucket>/... is what documents call
s3Bucket, by default.
"""

import hashlib
import re
from string import Formatter

from specs.errors import DocumentError
from specs.job_kinds import CHUNK, CHUNK_START, CONTACT_SHEET, EXPORT_PART, SEARCH_STEP, TAGS, TAGS_WITHIN, WORLD

NAME_RULE = "1 to 64 of A-Z a-z 0-9 _ -, the first a letter or a digit"
MOST_KEY_BYTES = 1024
KEY_RULE = f"parts joined by /, none empty or beginning with a dot, at most {MOST_KEY_BYTES} bytes"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,127}")
_BUCKET = re.compile(r"(?!.*\.\.)[a-z0-9][a-z0-9.-]{1,61}[a-z0-9]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")
_PARTS = {"digest": (_DIGEST, "64 lower-case hex digits"), "file": (_FILE, "a plain file name")}
"""What may stand in a part of a form, and the rule in words; in every other part, a name."""
_DIGITS = re.compile(r"[0-9]+")


def fill(form: str, **parts: str | int) -> str:
    """Returns the key of a form; the parts are text that is checked, or numbers.

    Raises:
        DocumentError: Text may not stand in its part.
    """
    return form.format(**{part: _part(part, text) for part, text in parts.items()})


def key_pattern(form: str, **known: str) -> re.Pattern[str]:
    """Returns what matches the keys of a form, with a group for each part.

    Args:
        form: The form.
        known: Regular expressions of parts that are narrower than the form itself says.
    """
    expression = ""
    for text, part, spec, _ in Formatter().parse(form):
        expression += re.escape(text)
        if part:
            broad = _DIGITS.pattern if spec else _PARTS[part][0].pattern if part in _PARTS else "[^/]+"
            expression += f"(?P<{part}>{known.get(part, broad)})"
    return re.compile(expression)


def _part(part: str, text: str | int) -> str | int:
    if isinstance(text, int):
        return text
    pattern, rule = _PARTS.get(part, (_NAME, NAME_RULE))
    return _match(pattern, text, part, rule)


def folder(form: str, **parts: str) -> str:
    """Returns the folder that the first two parts of a form name."""
    return fill("/".join(form.split("/")[:2]), **parts)


def checked_key(key: str) -> str:
    """Returns the key, if it is one.

    Raises:
        DocumentError: It could leave the store's folder, or collide with what the store hides there.
    """
    parts = key.split("/")
    if (
        len(key.encode()) > MOST_KEY_BYTES
        or _CONTROL.search(key)
        or any(not part or part.startswith(".") for part in parts)
    ):
        raise _refused("key", key, KEY_RULE)
    return key


def checked_name(name: str, what: str = "name") -> str:
    """Returns the name, if it may stand in a key; ``what`` names it in the error.

    Raises:
        DocumentError: It may not.
    """
    return _match(_NAME, name, what, NAME_RULE)


def checked_bucket(bucket: str) -> str:
    """Returns the bucket's name, if it is one by S3's rules.

    Raises:
        DocumentError: It is not.
    """
    return _match(_BUCKET, bucket, "s3Bucket", "3 to 63 of a-z 0-9 . -, ends in letters or digits, no two dots")


def _match(pattern: re.Pattern[str], text: str, what: str, rule: str) -> str:
    if not pattern.fullmatch(text):
        raise _refused(what, text, rule)
    return text


def _refused(what: str, text: str, rule: str) -> DocumentError:
    return DocumentError.of(what, repr(text[:80]), rule, source="store")


STORE = "store.json"
"""The store's id, written once its promises were probed."""
TOKEN = "tokens/{kind}/{digest}.json"  # noqa: S105 - a form, no secret
"""Which job a clientRequestToken made; the digest is the token's."""
JOB = "jobs/{kind}/{job}.json"
"""A job's record."""
CLAIM = "claims/{kind}/{job}.json"
"""Which live process works on a job."""
QUEUE = "queue/{kind}/{job}.json"
"""That a job waits for a worker; removed once it has ended."""
TEMPLATE = "templates/{template}.json"
"""The body of a world template; jobs name it by its digest."""
NAMED_TEMPLATE = "world-templates/{template}.json"
"""A template that somebody named, and which body it has now."""
NAMED_TEMPLATE_PREFIX = "wt-"
"""What the ids of named templates begin with; a digest, which names a body, never does."""
TEMPLATE_NAME = "template-names/{digest}.json"
"""Which template has a name; the digest is the name's."""
RESULT = "results/{batch}/{file}"
"""Evidence and notes of a batch."""
ATTEMPT = "attempts/{attempts}/{episodes}/{error:010d}.json"
"""That a gate did not pass on some episodes; attempts of document, gate and tested version are counted together."""
BUNDLE = "bundles/{digest}"
"""An application bundle, named by its SHA-256."""
APPLICATION = "applications/{kind}/{application}.json"
"""The versions of an application."""
FLEET = "fleets/{fleet}.json"
"""A fleet."""
ROBOT_RECORD = "robots/{robot}/record.json"
"""Who the robot is."""
DESIRED = "robots/{robot}/desired.json"
"""What the robot shall run; the controller writes."""
REPORTED = "robots/{robot}/reported.json"
"""What the robot runs; only that robot writes."""
TRUST = "trust/{repository}/{file}"
"""Signed metadata of bundles and keys; no private key, ever."""
TREND = "trends/{document}.html"
"""In a document's bucket, below its prefix: the page of its nights, beside the folders of its batches."""
ACTIONS = "actions/{day}/{file}"
"""Who asked for which change over HTTP, a line each; a file is one gateway's, of an hour."""
UNNAMED = "housekeeping/unnamed.json"
"""Since when each bundle has been without a name, for the next time that somebody asks."""


def output_key(prefix: str | None, name: str) -> str:
    """Returns ``<prefix>/<name>``, for a document's s3Prefix with or without slashes around it, or None."""
    folder = (prefix or "").strip("/")
    return checked_key(f"{folder}/{name}" if folder else name)


def job_key(kind: str, job_id: str) -> str:
    """Returns the key of a job record."""
    return fill(JOB, kind=kind, job=job_id)


def jobs_prefix(kind: str) -> str:
    """Returns the folder that holds the job records of a kind."""
    return folder(JOB, kind=kind)


def token_key(kind: str, token: str) -> str:
    """Returns the key of what a clientRequestToken made; tokens are free text, so the key holds their digest."""
    return fill(TOKEN, kind=kind, digest=hashlib.sha256(token.encode()).hexdigest())


def claim_key(kind: str, job_id: str) -> str:
    """Returns the key under which a process claims a job."""
    return fill(CLAIM, kind=kind, job=job_id)


def queue_key(kind: str, job_id: str) -> str:
    """Returns the key of a job's place in the queue."""
    return fill(QUEUE, kind=kind, job=job_id)


def queue_prefix() -> str:
    """Returns the folder that holds the queue."""
    return QUEUE.partition("/")[0]


def template_key(name: str) -> str:
    """Returns the key of a world template."""
    return fill(TEMPLATE, template=name)


def named_template_key(template: str) -> str:
    """Returns the key of a template that somebody named; names are free text, so it is its id that stands here."""
    return fill(NAMED_TEMPLATE, template=template)


def named_templates_prefix() -> str:
    """Returns the folder that holds the templates that somebody named."""
    return NAMED_TEMPLATE.partition("/")[0]


def template_name_key(name: str) -> str:
    """Returns the key of what says which template has a name."""
    return fill(TEMPLATE_NAME, digest=hashlib.sha256(name.encode()).hexdigest())


def tags_key(kind: str, path: str) -> str:
    """Returns the key of the tags that a resource was given later; its path is as in its ARN."""
    parent, _, name = path.rpartition("/")
    return fill(TAGS_WITHIN, kind=kind, parent=parent, name=name) if parent else fill(TAGS, kind=kind, name=name)


def world_key(generation: str, world: str) -> str:
    """Returns the key of a world."""
    return fill(WORLD, generation=generation, world=world)


def worlds_prefix(generation: str) -> str:
    """Returns the folder that holds the worlds of a generation job."""
    return folder(WORLD, generation=generation)


def contact_sheet_key(generation: str) -> str:
    """Returns the key of the sheet that shows the worlds of a generation job."""
    return fill(CONTACT_SHEET, generation=generation)


def export_part_key(export: str, generation: str, world: str) -> str:
    """Returns the key of what a worker made of one world for an export job."""
    return fill(EXPORT_PART, export=export, generation=generation, world=world)


def export_parts_prefix(export: str) -> str:
    """Returns the folder that holds what workers made for an export job."""
    return folder(EXPORT_PART, export=export)


def chunk_key(batch: str, number: int) -> str:
    """Returns the key of the results of a batch's chunk."""
    return fill(CHUNK, batch=batch, number=number)


def chunk_start_key(batch: str, number: int) -> str:
    """Returns the key of when a batch's chunk was begun."""
    return fill(CHUNK_START, batch=batch, number=number)


def chunks_prefix(batch: str) -> str:
    """Returns the folder that holds the chunks of a batch."""
    return folder(CHUNK, batch=batch)


def search_step_key(batch: str, digest: str, number: int) -> str:
    """Returns the key of what came of a step of a search over a batch; the digest is of what is searched for."""
    return fill(SEARCH_STEP, batch=batch, digest=digest, number=number)


def result_key(batch: str, name: str) -> str:
    """Returns the key of one of a batch's files, such as ``evidence.json``."""
    return fill(RESULT, batch=batch, file=name)


def attempt_key(attempts: str, episodes: str, error: int) -> str:
    """Returns the key that says that a gate did not pass on some episodes; by chance it does wrongly, in billionths."""
    return fill(ATTEMPT, attempts=attempts, episodes=episodes, error=error)


def attempts_prefix(attempts: str) -> str:
    """Returns the folder that holds what a gate did not pass on."""
    return folder(ATTEMPT, attempts=attempts)


def actions_key(day: str, name: str) -> str:
    """Returns the key of a file of actions, of a day such as 2026-01-31."""
    return fill(ACTIONS, day=day, file=name)


def actions_prefix(day: str = "") -> str:
    """Returns the folder that holds the actions of a day, or those of all days."""
    return folder(ACTIONS, day=day) if day else ACTIONS.partition("/")[0]


def trend_key(document: str) -> str:
    """Returns the key of a document's trend, below the prefix of its bucket."""
    return fill(TREND, document=document)


def bundle_key(digest: str) -> str:
    """Returns the key of an application bundle."""
    return fill(BUNDLE, digest=digest)


def application_key(kind: str, name: str) -> str:
    """Returns the key of an application's versions."""
    return fill(APPLICATION, kind=kind, application=name)


def applications_prefix(kind: str) -> str:
    """Returns the folder that holds the applications of a kind."""
    return folder(APPLICATION, kind=kind)


def fleet_key(fleet: str) -> str:
    """Returns the key of a fleet."""
    return fill(FLEET, fleet=fleet)


def robot_record_key(robot: str) -> str:
    """Returns the key of a robot's record."""
    return fill(ROBOT_RECORD, robot=robot)


def desired_key(robot: str) -> str:
    """Returns the key of what a robot shall run."""
    return fill(DESIRED, robot=robot)


def reported_key(robot: str) -> str:
    """Returns the key of what a robot says it runs."""
    return fill(REPORTED, robot=robot)


def trust_key(repository: str, name: str) -> str:
    """Returns the key of one of a repository's signed files, such as ``timestamp.json``."""
    return fill(TRUST, repository=repository, file=name)
