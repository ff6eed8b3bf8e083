"""What a person may call a resource: its ARN, RoboMaker's old one, or its bare id or name, looked up in the store."""

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from typing import NamedTuple

from specs.arn import KINDS, Reference, ResourceKind, absence, arn, parse_reference
from specs.errors import DocumentError, ResourceNotFound
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.storage.base.keys import (
    NAMED_TEMPLATE_PREFIX,
    application_key,
    fleet_key,
    job_key,
    named_template_key,
    robot_record_key,
    template_key,
    world_key,
)
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.store_url import store_id
from tasks.storage.templates import find_template_name

_BATCH: JobKind = "simulation-job-batch"
_NEAR = 0.75
_NEAR_AT_MOST = 3
_ANY = "x"
_KEYS = {"world-template": template_key, "deployment-fleet": fleet_key, "robot": robot_record_key}


class NamedResource(NamedTuple):
    """A resource that is in the store: its kind, and its path as in an ARN."""

    kind: ResourceKind
    path: str


def find_resource(store: Store, text: str, wanted: Collection[ResourceKind]) -> NamedResource:
    """Returns the one resource that a text names.

    Args:
        store: Where it is.
        text: An ARN, or an id or name alone: ``simb-...``, ``simb-.../3``, ``run-...``, ``guides``.
        wanted: The kinds that it may be of.

    Raises:
        ResourceNotFound: The store has no such resource; the message names those that are called nearly so.
        DocumentError: It is of another kind, or there are several of that name.
    """
    reference = _parsed(text, wanted)
    kinds = _possible(reference)
    there: list[ResourceKind] = [kind for kind in kinds if _exists(store, kind, reference.path)]
    fitting = [NamedResource(kind, reference.path) for kind in there if kind in wanted]
    if reference.kind is None and "world-template" in wanted and (named := find_template_name(store, text)):
        fitting.append(NamedResource("world-template", named.id))
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        arns = ", ".join(arn(each.kind, store_id(store), each.path) for each in fitting)
        raise _refused(text, f"there are several of that name; name one by its ARN: {arns}")
    if other := there or [kind for kind in kinds if reference.kind and kind not in wanted]:
        raise _refused(text, _other_kind(other[0], reference.path, wanted))
    raise _missing(store, reference, [kind for kind in kinds if kind in wanted] or list(wanted))


def resource_arn(store: Store, text: str) -> str:
    """Returns the ARN of what a text names; an ARN is returned as it is, whether or not there is such a resource.

    Raises:
        ResourceNotFound: The store has no resource of that id or name.
        DocumentError: There are several of that name, or it is an ARN of no kind of resource.
    """
    if _parsed(text, KINDS).kind:
        return text
    found = find_resource(store, text, KINDS)
    return arn(found.kind, store_id(store), found.path)


def find_batch_name(store: Store, text: str) -> str:
    """Returns the id of the batch that a text names: a batch, one of its jobs, or the run of a document with one.

    Raises:
        ResourceNotFound: The store has no such resource, or the run has not begun its batch.
        DocumentError: It is of another kind, or a run of a document without a batch.
    """
    found = find_resource(store, text, (_BATCH, "simulation-job", "pipeline-run"))
    if found.kind != "pipeline-run":
        return found.path.partition("/")[0]
    for kind, job in jobs_of(read(store, "pipeline-run", found.path)):
        if kind == _BATCH:
            return job
    raise _refused(text, "a run with a simulationBatch; this document has none")


def _parsed(text: str, wanted: Collection[ResourceKind]) -> Reference:
    try:
        return parse_reference(text)
    except ValueError as exc:
        raise _refused(text, f"the ARN, the id or the name of {_any_of(wanted)}: {exc}") from exc


def _possible(reference: Reference) -> Sequence[ResourceKind]:
    """Returns the kinds that a name may be of by its form; of an ARN, the one that it says."""
    if reference.kind:
        return (reference.kind,)
    first, slash, _ = reference.path.partition("/")
    of_job = [kind for kind, each in JOB_KINDS.items() if first.startswith(f"{each.prefix}-")]
    if slash:
        return ("simulation-job",) if _BATCH in of_job else ("world",)
    return [kind for kind in KINDS if kind in of_job or kind not in {*JOB_KINDS, "world", "simulation-job"}]


def _exists(store: Store, kind: ResourceKind, path: str) -> bool:
    try:
        return store.exists(_key(kind, path))
    except DocumentError:  # nothing can be called so
        return False


def _key(kind: ResourceKind, path: str) -> str:
    """Returns the key of a resource's record; of a simulation job, of its batch, which knows how many it has."""
    parent, _, name = path.partition("/")
    match kind:
        case "world":
            return world_key(parent, name)
        case "robot-application" | "simulation-application":
            return application_key(kind, path)
        case "simulation-job":
            return job_key(_BATCH, parent)
        case "world-template" if path.startswith(NAMED_TEMPLATE_PREFIX):
            return named_template_key(path)
        case "world-template" | "deployment-fleet" | "robot":
            return _KEYS[kind](path)
        case _:
            return job_key(kind, path)


def _missing(store: Store, reference: Reference, kinds: Sequence[ResourceKind]) -> ResourceNotFound:
    jobs: list[ResourceKind] = [kind for kind in kinds if kind in JOB_KINDS]
    shown = jobs if len(jobs) == 1 else kinds
    near = [name for kind in shown for name in _near(store, kind, reference.path)][:_NEAR_AT_MOST]
    what = shown[0] if len(shown) == 1 else "name"
    return ResourceNotFound.of(what, repr(reference.path), absence(shown, store.url, near), source="simyard")


def _near(store: Store, kind: ResourceKind, path: str) -> list[str]:
    """Returns what the store has that is called nearly so: it begins with the name, or differs in a letter or two."""
    before = path.partition("/")[0] + "/" if kind == "world" else ""
    behind = "/" + path.partition("/")[2] if kind == "simulation-job" and "/" in path else ""
    wanted = path.removeprefix(before).removesuffix(behind)
    names = _names_beside(store, kind, before)
    longer = [each for each in names if wanted and each.startswith(wanted)]
    near = dict.fromkeys([*longer, *get_close_matches(wanted, names, _NEAR_AT_MOST, _NEAR)])
    return [f"{before}{each}{behind}" for each in near]


def _names_beside(store: Store, kind: ResourceKind, before: str) -> list[str]:
    """Returns the names of all resources of a kind; of worlds, those of the generation that stands before the name."""
    try:
        folder = _key(kind, f"{before}{_ANY}").rpartition(f"/{_ANY}")[0]
    except DocumentError:  # a generation that nothing can be called
        return []
    names = {key.removeprefix(f"{folder}/").partition("/")[0] for key in store.keys(folder)}
    return sorted(name.removesuffix(".json") for name in names)


def _other_kind(kind: ResourceKind, path: str, wanted: Collection[ResourceKind]) -> str:
    example = f", such as {path}/0" if kind == _BATCH and "simulation-job" in wanted else ""
    return f"{_any_of(wanted)}{example}; this is a {kind}"


def _any_of(kinds: Collection[ResourceKind]) -> str:
    return " or ".join(f"a {kind}" for kind in kinds)


def _refused(text: str, allowed: str) -> DocumentError:
    return DocumentError.of("name", repr(text), allowed, source="simyard")
