"""The pages of worlds, of the jobs that make and export them, and of templates."""

import json
from collections.abc import Mapping
from pathlib import PurePosixPath

from pydantic import JsonValue, ValidationError

from flows.gateway.page.files import world_body
from flows.gateway.page.request_context import (
    RequestContext,
    address,
    job,
    known_job,
    known_jobs,
    missing,
    named,
    newest_jobs,
    newest_names,
    number,
    read_bytes,
    state,
    step_of,
    tag_rows,
    when,
)
from specs.data.world import World
from specs.job_kinds import JobKind
from tasks.gateway.page.content import Block, Cell, Facts, Gallery, Page, Picture, Table, Text
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX, contact_sheet_key, named_templates_prefix, template_key
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.templates import read_template
from tasks.storage.worlds import decode_world

_GENERATION: JobKind = "world-generation-job"
_EXPORT: JobKind = "world-export-job"
_PICTURES = 24
_MOST_TEMPLATE_BYTES = 1 << 20
_REASON_CHARACTERS = 400


def worlds_gallery(context: RequestContext, most: int = _PICTURES, href: str = "") -> Gallery:
    """Returns the newest worlds; with an address for all of them, no more than the first."""
    names = newest_names(context, "worlds", lambda key: _world_of(context, key))
    shown, steps = step_of(context, names, "/worlds", most)
    pictures = tuple(_picture(world) for world in shown)
    empty = "No world yet: simyard run, or CreateWorldGenerationJob, makes some."
    return Gallery("Worlds", pictures, empty=empty, href=href if steps else "", steps=None if href else steps)


def worlds_page(context: RequestContext) -> Page:
    """Returns the pictures of all worlds."""
    return Page("Worlds", blocks=(worlds_gallery(context),))


def world_page(context: RequestContext, generation: str, name: str) -> Page:
    """Returns the page of a world.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no world's.
    """
    path = f"{generation}/{name}"
    body = world_body(context, generation, name)
    trail = (("Worlds", "/worlds"), (generation, address(_GENERATION, generation)))
    try:
        world = decode_world(body)
    except ValidationError:
        sentence = "What lies here was not written by this version of Simyard, so there is no picture of it."
        return Page(name, "World", sentence=sentence, trail=trail)
    record = known_job(context.store, _GENERATION, generation)
    rooms = f"{len(world.areas)} room{'' if len(world.areas) == 1 else 's'}"
    picture = Picture(f"{address('world', path)}.svg", f"Floor plan of {name} with {rooms}")
    blocks: list[Block] = [Gallery("Floor plan", (picture,), is_wide=True), _certificate(world), _rooms(world)]
    if unmet := [wish for wish in world.certificate.wishes if not wish.met]:
        rows = tuple((Cell(each.subject), Cell(each.kind), Cell(each.wished), Cell(each.found)) for each in unmet)
        blocks.append(Table("Wishes that are not met", ("Of", "Wish", "Wished", "Found"), rows))
    blocks.append(_origin(context, world, record))
    return Page(name, "World", trail=trail, blocks=tuple(blocks))


def generations_page(context: RequestContext) -> Page:
    """Returns the list of generation jobs."""
    shown, steps = step_of(context, newest_jobs(context, _GENERATION), "/generations")
    rows = tuple(
        (
            Cell(record.id, address(_GENERATION, record.id)),
            state(record.status),
            number(len(_worlds(record))),
            _template(record),
            when(record.updated_at_s),
            Cell(context.plain(record.failure_reason)),
        )
        for record in known_jobs(context, _GENERATION, shown)
    )
    columns = ("Job", "Status", "Worlds", "Template", "Changed", "Why not")
    table = Table("Generation jobs", columns, rows, "None yet.", steps=steps)
    return Page("Generation jobs", blocks=(table,))


def generation_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a generation job: its worlds, and the sheet that shows them.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    record = job(context, _GENERATION, name)
    here, worlds = address(_GENERATION, name), _worlds(record)
    shown, steps = step_of(context, worlds, here, _PICTURES)
    rows = [
        ("worlds made", Cell(f"{len(worlds):,}")),
        ("template", _template(record)),
        ("seed", Cell(str(record.detail.get("seed", record.request.get("seed", ""))))),
        ("begun", when(record.created_at_s)),
        ("changed", when(record.updated_at_s)),
        ("failure code", Cell(record.failure_code)) if record.failure_code else None,
        *context.arn_rows(record.arn),
        *tag_rows(context, _GENERATION, name, record.request.get("tags")),
    ]
    blocks: list[Block] = [Facts("The job", tuple(row for row in rows if row))]
    if failures := _failures(context, record):
        blocks.append(Table("Worlds that could not be made", ("Code", "Worlds", "Why one of them"), failures))
    if context.store.exists(contact_sheet_key(name)):
        sheet = Picture(f"{here}/contact-sheet.svg", f"Contact sheet of the worlds of {name}")
        blocks.append(Gallery("Contact sheet", (sheet,), is_wide=True))
    pictures = tuple(_picture(world) for world in shown)
    blocks.append(Gallery("Worlds", pictures, empty="No world yet.", steps=steps))
    why, going = context.plain(record.failure_reason), not is_terminal(record)
    trail = (("Generation jobs", "/generations"),)
    return Page(name, "World generation job", record.status, why, trail, blocks=tuple(blocks), is_going=going)


def exports_page(context: RequestContext) -> Page:
    """Returns the list of export jobs."""
    shown, steps = step_of(context, newest_jobs(context, _EXPORT), "/exports")
    rows = tuple(
        (
            Cell(record.id, address(_EXPORT, record.id)),
            state(record.status),
            number(len(_texts(record.request.get("worlds")))),
            Cell(_place(record)),
            when(record.updated_at_s),
            Cell(context.plain(record.failure_reason)),
        )
        for record in known_jobs(context, _EXPORT, shown)
    )
    columns = ("Job", "Status", "Worlds", "Bucket", "Changed", "Why not")
    return Page("Export jobs", blocks=(Table("Export jobs", columns, rows, "None yet.", steps=steps),))


def export_page(context: RequestContext, name: str) -> Page:
    """Returns the page of an export job.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    record = job(context, _EXPORT, name)
    worlds = _texts(record.request.get("worlds"))
    shown, steps = step_of(context, worlds, address(_EXPORT, name))
    rows = [
        ("bucket", Cell(_place(record))),
        ("formats", Cell(", ".join(_texts(record.request.get("formats"))))),
        ("zip", Cell(context.plain(str(record.detail["zip"])))) if "zip" in record.detail else None,
        ("SHA-256", Cell(str(record.detail["sha256"]), is_code=True)) if "sha256" in record.detail else None,
        ("begun", when(record.created_at_s)),
        ("changed", when(record.updated_at_s)),
        ("failure code", Cell(record.failure_code)) if record.failure_code else None,
        *context.arn_rows(record.arn),
        *tag_rows(context, _EXPORT, name, record.request.get("tags")),
    ]
    facts = Facts("The job", tuple(row for row in rows if row and (row[1].text or row[1].at_s)))
    table = Table("Worlds", ("World",), tuple((named(world, "world"),) for world in shown), "None.", steps=steps)
    why, going = context.plain(record.failure_reason), not is_terminal(record)
    trail = (("Export jobs", "/exports"),)
    return Page(name, "World export job", record.status, why, trail, blocks=(facts, table), is_going=going)


def templates_page(context: RequestContext) -> Page:
    """Returns the list of templates: those that somebody named, and the bodies that jobs have used."""

    def name_of(key: str) -> str:
        name = PurePosixPath(key).stem
        return name if context.may_read(context.arn("world-template", name)) else ""

    shown, steps = step_of(context, newest_names(context, named_templates_prefix(), name_of), "/templates")
    named_rows = tuple(
        (Cell(each.name or each.id, address("world-template", each.id)), Cell(each.version), when(each.updated_at_s))
        for each in (read_template(context.store, template) for template in shown)
    )
    columns = ("Template", "Version", "Changed")
    templates = Table("Templates", columns, named_rows, "CreateWorldTemplate makes one.", steps=steps)
    shown, steps = step_of(context, newest_names(context, "templates", name_of), "/templates")
    rows = tuple((Cell(name, address("world-template", name)),) for name in shown)
    bodies = Table("Bodies", ("Digest",), rows, "A generation job keeps the one that it used.", steps=steps)
    return Page("Templates", blocks=(templates, bodies))


def template_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a template: its body.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no template's.
    """
    context.require("world-template", name)
    template = read_template(context.store, name) if name.startswith(NAMED_TEMPLATE_PREFIX) else None
    digest = template.digest if template else name
    body = read_bytes(context.store, template_key(digest), _MOST_TEMPLATE_BYTES)
    if body is None:
        raise missing("world-template", name)
    try:
        text = json.dumps(json.loads(body), indent=2, ensure_ascii=False)
    except (ValueError, RecursionError):
        text = body.decode(errors="replace")
    times = (("made", when(template.created_at_s)), ("changed", when(template.updated_at_s))) if template else ()
    rows = (
        *context.arn_rows(context.arn("world-template", name)),
        ("body", Cell(digest, is_code=True)),
        *times,
    )
    facts = Facts(
        "The template", (*rows, *tag_rows(context, "world-template", name, template.tags if template else None))
    )
    title = template.name or name if template else name
    return Page(title, "World template", trail=(("Templates", "/templates"),), blocks=(facts, Text("Body", text)))


def _certificate(world: World) -> Facts:
    found = world.certificate
    rows = (
        ("every room is reached by a robot of radius", Cell(f"{found.reachable_robot_radius_m:.2f} m")),
        ("with the doors as they stand", Cell(f"{found.doors_as_set_robot_radius_m:.2f} m")),
        ("asked for", Cell(f"{found.guaranteed_robot_radius_m:.2f} m")),
        ("free around the start", Cell(f"{found.origin_clear_radius_m:.2f} m")),
        ("narrowest passage", Cell(f"{found.narrowest_passage_m:.2f} m")),
        ("free floor", Cell(f"{100 * found.free_floor_share:.0f} %")),
        ("pieces that overlap", Cell(str(found.overlaps))),
        ("wishes met", Cell(f"{sum(wish.met for wish in found.wishes)} of {len(found.wishes)}")),
    )
    return Facts("Certificate", rows)


def _rooms(world: World) -> Table:
    if world.zones:
        zones = ((zone.name, zone.area_m2, "found where doors part" if zone.found else "named") for zone in world.zones)
        rows = tuple((Cell(name), number(area_m2, "m²", 1), Cell(how)) for name, area_m2, how in zones)
        return Table("Rooms", ("Room", "Area", "How it is known"), rows)
    figures = {each.room: each for each in world.certificate.rooms}
    rows = tuple(
        (
            Cell(room.name),
            Cell(room.type),
            number(figures[room.name].area_m2, "m²", 1) if room.name in figures else Cell(is_number=True),
            number(100 * figures[room.name].free_floor_share, "%", 0) if room.name in figures else Cell(is_number=True),
            number(100 * figures[room.name].reached_share, "%", 0) if room.name in figures else Cell(is_number=True),
            number(sum(piece.room == room.name for piece in world.furniture)),
        )
        for room in world.rooms
    )
    return Table("Rooms", ("Room", "Type", "Area", "Free floor", "Reached", "Pieces"), rows)


def _origin(context: RequestContext, world: World, record: JobRecord | None) -> Facts:
    path = f"{world.generation}/{world.name}"
    rows = [
        ("generation job", Cell(record.id, address(_GENERATION, record.id))) if record else None,
        ("template", _template(record)) if record else None,
        ("made", when(record.created_at_s)) if record else None,
        ("seed", Cell(str(world.seed))),
        ("generator", Cell(world.generator)),
        *context.arn_rows(context.arn("world", path)),
        *tag_rows(context, "world", path, record.request.get("worldTags") if record else None),
    ]
    return Facts("Where it is from", tuple(row for row in rows if row))


def _world_of(context: RequestContext, key: str) -> str:
    path, dot, ending = key.removeprefix("worlds/").rpartition(".")
    is_world = ending == "json" and path.count("/") == 1 and context.may_read(context.arn("world", path))
    return path if dot and is_world else ""


def _picture(world: str) -> Picture:
    generation, _, name = world.partition("/")
    here = address("world", world)
    return Picture(f"{here}.svg", f"Floor plan of {name}", name, here, generation)


def _template(record: JobRecord) -> Cell:
    found = named(record.request.get("template"), "world-template")
    return Cell(found.text if len(found.text) < 64 else f"{found.text[:12]}…", found.href)


def _worlds(record: JobRecord) -> list[str]:
    return _texts(record.detail.get("worlds"))


def _texts(given: JsonValue) -> list[str]:
    return [each for each in given if isinstance(each, str)] if isinstance(given, list) else []


def _place(record: JobRecord) -> str:
    place = record.request.get("outputLocation")
    fields = place if isinstance(place, dict) else {}
    return "/".join(str(fields[name]) for name in ("s3Bucket", "s3Prefix") if fields.get(name))


def _failures(context: RequestContext, record: JobRecord) -> tuple[tuple[Cell, ...], ...]:
    found = record.detail.get("failures")
    given: Mapping[str, JsonValue] = found if isinstance(found, dict) else {}
    return tuple(
        (
            Cell(code),
            Cell(str(each.get("count", ""))),
            Cell(context.plain(str(each.get("sample_reason", "")))[:_REASON_CHARACTERS]),
        )
        for code, each in given.items()
        if isinstance(each, dict)
    )
