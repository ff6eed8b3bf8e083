"""Worlds for Python: imported, of a template, a job, a run, or the store. Imports what it needs when it is called."""
# ruff: noqa: PLC0415 - see above

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from flows.preview.world_preview import WorldRequest
    from simyard.answer.run_answers import Run, World, Worlds
    from specs.data.world import World as WorldDocument
    from specs.template.body import TemplateBody
    from tasks.storage.base.store import Store

_RADIUS_M = 0.25


def worlds(
    source: "str | os.PathLike[str] | Mapping[str, object] | Run | None" = None,
    *,
    base: str | os.PathLike[str] | None = None,
    store: str | os.PathLike[str] | None = None,
    count: int = 6,
    seed: int = 0,
    robot_radius_m: float = _RADIUS_M,
) -> "Worlds":
    """Returns worlds: those of a run, of a generation job, of the store, one by its name, or new ones of a template.

    Args:
        source: What `simyard.run` returned; a job's ARN or id; a world's ARN or `<generation>/<world>`; a template as
            a document names one, or its body; None for all worlds of the store.
        base: Folder that a template's relative path starts from; the working directory.
        store: `file:///folder`, `s3://bucket/prefix` or a folder; a run's own, else SIMYARD_STORE, else `.simyard`
            in the working directory.
        count: How many floor plans of a template are made, which are kept nowhere.
        seed: For a template: the same seed makes the same worlds.
        robot_radius_m: For a template: of the robot that gets into every room.

    Raises:
        DocumentError: There is no such template, job or world, or the job has no worlds.
        WorldRejected: The template gives no world.
    """
    from flows.preview.world_preview import WorldRequest
    from simyard.answer.run_answers import Run
    from simyard.document_calls import store_url
    from tasks.storage.store_url import open_existing_store, open_store

    if isinstance(source, Run):
        return _of_run(source)
    if source is None:
        return _of_store(open_existing_store(store_url(store)))
    opened = open_store(store_url(store))
    name = source if isinstance(source, str) else ""
    if found := _known(name, opened):
        return found
    body, title = _template(source, opened, Path.cwd() if base is None else Path(base))
    return _of_template(body, title, count, WorldRequest(seed, robot_radius_m))


def world_import(
    source: str | os.PathLike[str],
    *,
    name: str | None = None,
    start: Sequence[float] | None = None,
    models: Sequence[str | os.PathLike[str]] = (),
    wall_height_m: float | None = None,
    unit: str | None = None,
    routes: Sequence[str | os.PathLike[str]] = (),
    store: str | os.PathLike[str] | None = None,
) -> "World":
    """Returns a world made of a building of one's own, which is in the store then; `document.report` says what became.

    Args:
        source: A map of ROS (`.yaml`), a Gazebo world (`.world`, `.sdf`), a MuJoCo scene (`.xml`), or a mesh.
        name: The world's; the file's, if it is left out.
        start: Where the robot starts (x, y, yaw), in the source's frame; found, if it is left out.
        models: Folders that `model://` and `package://` lead to.
        wall_height_m: How high stands what a map shows; 2 m.
        unit: Of a mesh: m, cm, mm, in or ft.
        routes: Files of routes, places and zones, such as Nav2's waypoints, in the source's frame.
        store: As for `worlds`.

    Raises:
        DocumentError: It is no world that can be imported; with all its faults.
    """
    from flows.pipeline.world_imports import import_world, keep_world
    from flows.preview.world_preview import read_import_options
    from simyard.answer.run_answers import World
    from simyard.document_calls import store_url
    from tasks.storage.store_url import open_store

    asked = read_import_options(
        {
            "name": name,
            "source": os.fspath(source),
            "start": ",".join(map(str, start)) if start else None,
            "models": [os.fspath(each) for each in models] or None,
            "wallHeight": wall_height_m,
            "unit": unit,
            "routes": [os.fspath(each) for each in routes] or None,
        }
    )
    opened = open_store(store_url(store))
    imported = import_world(asked, Path.cwd())
    keep_world(opened, imported)
    return World(imported.reference, imported.world)


def _of_run(run: "Run") -> "Worlds":
    from simyard.answer.run_answers import Worlds
    from specs.arn import resource_name
    from tasks.storage.jobs.records import read
    from tasks.storage.store_url import open_existing_store

    store = open_existing_store(run.store)
    pins = cast("Mapping[str, Any]", read(store, "pipeline-run", run.id).request.get("pins") or {})
    # Variants of a building come in the order of their numbers, not of their names.
    own = sorted(pins.get("worlds") or {}, key=lambda name: (len(name), name))
    if run.generation is None:
        title = run.report.name if own else f"{run.report.name} made no worlds"
        return Worlds(title, tuple(own), _read=lambda name: _read(store, name))
    made = _of_job(store, resource_name(run.generation))
    return replace(made, names=(*own, *made.names))


def _known(name: str, store: "Store") -> "Worlds | None":
    """Returns the worlds that a name stands for in the store; None for what may be a template."""
    from simyard.answer.run_answers import Worlds
    from specs.arn import parse_reference, resource_kind
    from specs.errors import DocumentError, StoreError
    from tasks.storage.worlds import world_bytes
    from tasks.worlds.job.generation_job import KIND

    kind = resource_kind(name)
    if kind == KIND or (name.startswith("wgj-") and "/" not in name):
        return _of_job(store, parse_reference(name).path)
    path = parse_reference(name).path if kind == "world" else name
    if kind != "world":
        try:
            world_bytes(store, path)
        except (DocumentError, StoreError):
            return None
    return Worlds(path, (path,), _read=lambda each: _read(store, each))


def _of_job(store: "Store", job: str) -> "Worlds":
    from simyard.answer.run_answers import Worlds
    from specs.errors import DocumentError
    from tasks.storage.jobs.records import read
    from tasks.worlds.job.generation_job import KIND

    names = cast("list[str]", read(store, KIND, job).detail.get("worlds", []))
    if not names:
        raise DocumentError.of(KIND, repr(job), "a job that has made worlds")
    return Worlds(job, tuple(names), _read=lambda name: _read(store, name))


def _of_store(store: "Store") -> "Worlds":
    from simyard.answer.run_answers import Worlds
    from specs.arn import resource_name
    from tasks.worlds.job.world_answers import list_worlds

    names = tuple(resource_name(each.arn) for each in list_worlds(store) if each.arn)
    return Worlds(f"all worlds of {store.url}", names, _read=lambda name: _read(store, name))


def _template(
    source: "str | os.PathLike[str] | Mapping[str, object]", store: "Store", base: Path
) -> "tuple[TemplateBody, str]":
    """Returns a template, and what a sheet calls it."""
    from specs.template.body import TemplateBody
    from tasks.documents.parse import parse
    from tasks.documents.template_source import find_template

    if isinstance(source, Mapping):
        return parse(TemplateBody, cast("Any", dict(source)), "template"), "a template"
    return find_template(os.fspath(source), store, base), Path(source).name


def _of_template(body: "TemplateBody", title: str, count: int, asked: "WorldRequest") -> "Worlds":
    from flows.preview.world_preview import worlds_of_template
    from simyard.answer.run_answers import Worlds

    made = worlds_of_template(body, f"{title}, seed {asked.seed}", count, asked)
    documents = {f"{each.generation}/{each.name}": each for each in made.worlds}
    return Worlds(made.title, tuple(documents), made.rejected, _read=documents.__getitem__)


def _read(store: "Store", name: str) -> "WorldDocument":
    from tasks.storage.worlds import read_world

    return read_world(store, name, "simyard.worlds")
