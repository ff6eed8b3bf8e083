"""`simyard world preview` and `sheet`: selects worlds of a template or a job, and writes their drawings."""

from dataclasses import dataclass
from pathlib import Path
from typing import cast

from specs.arn import parse_reference, resource_kind
from specs.base import Fault
from specs.data.world import World
from specs.errors import DocumentError
from specs.template.body import TemplateBody
from tasks.documents.template_source import find_template
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.worlds import read_world
from tasks.worlds.generate import generate_world
from tasks.worlds.job.job import KIND
from tasks.worlds.rejection import WorldRejected

_GENERATION = "preview"
_JOB_ID = "wgj-"


@dataclass(frozen=True)
class WorldRequest:
    """What decides worlds beside their template.

    Attributes:
        seed: At least 0.
        robot_radius_m: Of the robot that gets into every room.
    """

    seed: int
    robot_radius_m: float


@dataclass(frozen=True)
class WorldSelection:
    """Worlds for a sheet.

    Attributes:
        title: What they have in common.
        worlds: At least one.
        total: How many there are, of which these are the first.
        rejected: Why others could not be made, one sentence each.
    """

    title: str
    worlds: tuple[World, ...]
    total: int
    rejected: tuple[str, ...] = ()


def make_world(template: TemplateBody, asked: WorldRequest, floorplan: int, interior: int) -> World:
    """Returns the world of a template at two indices, from 1.

    Args:
        template: What worlds are made from.
        asked: What decides worlds beside their template.
        floorplan: Index of the floor plan, from 1.
        interior: Index of the interior of that floor plan, from 1.

    Raises:
        WorldRejected: It cannot be made.
    """
    return generate_world(
        template,
        seed=asked.seed,
        generation=_GENERATION,
        floorplan_index=floorplan,
        interior_index=interior,
        robot_radius_m=asked.robot_radius_m,
    )


def select_worlds(reference: str, store: Store, base: Path, count: int, asked: WorldRequest) -> WorldSelection:
    """Returns the first worlds of a generation job, or the first floor plans that a template gives.

    Args:
        reference: A job's ARN or id, or a template as a document names one.
        store: Where jobs and templates are.
        base: Folder that a template's relative path starts from.
        count: How many worlds at most.
        asked: For a template.

    Raises:
        DocumentError: There is no such job or template, or the job has no worlds.
        WorldRejected: The template gives no world.
    """
    if _names_job(reference):
        return _of_job(store, parse_reference(reference).path, count)
    return worlds_of_template(
        find_template(reference, store, base), f"{Path(reference).name}, seed {asked.seed}", count, asked
    )


def worlds_of_template(template: TemplateBody, title: str, count: int, asked: WorldRequest) -> WorldSelection:
    """Returns the first floor plans that a template gives, each with its first interior.

    Args:
        template: What worlds are made from.
        title: What they have in common.
        count: How many floor plans are tried.
        asked: What decides worlds beside their template.

    Raises:
        WorldRejected: It gives no world.
    """
    worlds: list[World] = []
    rejected: list[WorldRejected] = []
    for floorplan in range(1, count + 1):
        try:
            worlds.append(make_world(template, asked, floorplan, 1))
        except WorldRejected as exc:
            rejected.append(exc)
    if not worlds:
        raise rejected[0]
    return WorldSelection(title=title, worlds=tuple(worlds), total=len(worlds), rejected=tuple(map(str, rejected)))


def write_drawing(output: Path, drawing: str) -> None:
    """Writes an SVG file.

    Raises:
        DocumentError: It cannot be written there.
    """
    if _beside(output) == output:
        raise _refused(output, "an SVG file; a picture in 3-D goes beside it as PNG")
    _write(output, drawing.encode())


def write_picture(output: Path, png: bytes) -> Path:
    """Returns the PNG file beside an SVG file, written.

    Raises:
        DocumentError: It cannot be written there.
    """
    _write(_beside(output), png)
    return _beside(output)


def _beside(output: Path) -> Path:
    return output.with_suffix(".png")


def _names_job(reference: str) -> bool:
    return resource_kind(reference) == KIND or reference.startswith(_JOB_ID)


def _of_job(store: Store, job: str, count: int) -> WorldSelection:
    references = cast("list[str]", read(store, KIND, job).detail.get("worlds", []))
    if not references:
        raise DocumentError([Fault(path=KIND, value=repr(job), allowed="a job that has made worlds")])
    worlds = tuple(read_world(store, reference, job) for reference in references[:count])
    return WorldSelection(title=job, worlds=worlds, total=len(references))


def _write(path: Path, body: bytes) -> None:
    try:
        path.write_bytes(body)
    except OSError as exc:
        raise _refused(path, f"a file that can be written ({exc.strerror})") from exc


def _refused(output: Path, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="--output", value=repr(str(output)), allowed=allowed)], "simyard")
