"""What a store holds of templates and worlds, in RoboMaker's words."""

from pathlib import PurePosixPath

from specs.arn import arn
from specs.base import Fault
from specs.errors import ObjectNotFound, ResourceNotFound
from specs.template import TemplateBody
from specs.world_descriptions import (
    DescribeWorldResponse,
    DescribeWorldTemplateResponse,
    TemplateSummary,
    WorldSummary,
)
from tasks.storage.keys import template_key, world_key
from tasks.storage.opening import store_id
from tasks.storage.records import JobKind, read, records
from tasks.storage.store import Store
from tasks.worlds.canonical import decode_world
from tasks.worlds.describe import describe_world, summarise_added_world, summarise_worlds

# Not from the job itself, which imports what makes worlds.
_KIND: JobKind = "world-generation-job"


def describe_stored_world(store: Store, path: str) -> DescribeWorldResponse:
    """Returns a world, by ``<generation>/<world>``; of one that somebody added no job is told.

    Raises:
        ResourceNotFound: There is no such world.
        DocumentError: The path is no world's.
    """
    generation, _, name = path.partition("/")
    body = _found(store, world_key(generation, name), "world", path)
    try:
        record = read(store, _KIND, generation)
    except ResourceNotFound:
        record = None
    return describe_world(decode_world(body), record, store_id(store))


def list_worlds(store: Store) -> list[WorldSummary]:
    """Returns the worlds of all generation jobs, oldest job first, and then those that somebody added, by name."""
    jobs = records(store, _KIND)
    generations = {record.id for record in jobs}
    names = [PurePosixPath(key) for key in store.keys("worlds") if key.endswith(".json")]
    added = [f"{each.parent.name}/{each.stem}" for each in names if each.parent.name not in generations]
    return [
        *(summary for record in jobs for summary in summarise_worlds(record)),
        *(summarise_added_world(reference, store_id(store)) for reference in added),
    ]


def describe_template(store: Store, name: str) -> DescribeWorldTemplateResponse:
    """Returns a template, by its name in the store: the digest of its body.

    Raises:
        ResourceNotFound: There is no such template.
        DocumentError: The name is none.
    """
    body = TemplateBody.model_validate_json(_found(store, template_key(name), "world-template", name))
    return DescribeWorldTemplateResponse(arn=_arn(store, name), name=name, version=body.Version)


def list_templates(store: Store) -> list[TemplateSummary]:
    """Returns the templates that worlds were made from, by name."""
    names = [PurePosixPath(key).stem for key in store.keys("templates")]
    found = [describe_template(store, name) for name in names]
    return [TemplateSummary(arn=template.arn, name=template.name, version=template.version) for template in found]


def _arn(store: Store, name: str) -> str:
    return arn("world-template", store_id(store), name)


def _found(store: Store, key: str, kind: str, path: str) -> bytes:
    try:
        return store.get(key).body
    except ObjectNotFound as exc:
        raise ResourceNotFound([Fault(path=kind, value=repr(path), allowed=f"a {kind} in {store.url}")]) from exc
