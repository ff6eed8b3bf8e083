"""World export, and the contact sheets of generated and imported worlds, as steps: plain functions of data."""

import base64
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import cast

from pydantic import JsonValue

from specs.errors import ObjectExists
from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export.job.export_job import ExportWorkers, run_export_job
from tasks.export.picture.contact_sheet import contact_sheet_svg
from tasks.progress.listener import stage_progress
from tasks.storage.base.keys import contact_sheet_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tasks.storage.worlds import read_world

_REASON_SHOWN = 200


def keep_contact_sheet(store: Store, generation: str, references: Sequence[str]) -> bytes:
    """Returns the sheet of a job's worlds, from the store or, the first time, drawn and kept there.

    Args:
        store: Where the worlds are.
        generation: The job's id.
        references: Its worlds, ``<generation>/<world>``, at least one; no more are read than are drawn.

    Raises:
        DocumentError: A world is missing, or from another version of Simyard.
    """
    key = contact_sheet_key(generation)
    if store.exists(key):
        return store.get(key).body
    worlds = (read_world(store, reference, generation) for reference in references)
    sheet = contact_sheet_svg(worlds, title=generation, total=len(references)).encode()
    with suppress(ObjectExists):  # another process drew the same worlds
        store.create(key, sheet)
    return sheet


def sheet_markdown(sheet: bytes, url: str, failures: Mapping[str, Mapping[str, JsonValue]]) -> str:
    """Returns a page that shows the sheet, says where it lies, and which worlds could not be made.

    Args:
        sheet: The SVG; it becomes part of the page, because a page of Prefect's cannot reach the store.
        url: Where it lies.
        failures: By RoboMaker's code: ``count`` and ``sample_reason``, as the job's record has them.
    """
    picture = base64.b64encode(sheet).decode()
    lines = ["# Worlds", f"![Contact sheet](data:image/svg+xml;base64,{picture})", f"The same as a file: `{url}`"]
    for code, failure in failures.items():
        reason = " ".join(str(failure["sample_reason"]).split()).replace("`", "'")[:_REASON_SHOWN]
        lines.append(f"{failure['count']} not made, {code}: `{reason}`")
    return "\n\n".join(lines) + "\n"


STAGE = "Export"


def export_worlds(
    store_url: str, request: CreateWorldExportJobRequest, *, formats: tuple[WorldFormat, ...], token: str
) -> JobRecord:
    """Returns the ended export job of the token.

    Args:
        store_url: Where worlds and records lie.
        request: RoboMaker's request.
        formats: What each world is written as.
        token: The client request token.
    """
    return export_elsewhere(store_url, request, formats=formats, token=token, elsewhere=None)


def export_elsewhere(
    store_url: str,
    request: CreateWorldExportJobRequest,
    *,
    formats: tuple[WorldFormat, ...],
    token: str,
    elsewhere: ExportWorkers | None,
) -> JobRecord:
    """Returns what `export_worlds` does, for which workers of a cluster write the worlds; for who holds them."""
    store, progress = open_store(store_url), stage_progress(STAGE)
    return run_export_job(store, request, formats=formats, token=token, progress=progress, elsewhere=elsewhere)


def draw_worlds(store_url: str, generation: JobRecord) -> str:
    """Returns a page, as Markdown, with the worlds of a generation job side by side; keeps their picture."""
    store = open_store(store_url)
    worlds = cast("list[str]", generation.detail["worlds"])
    failures = cast("Mapping[str, Mapping[str, JsonValue]]", generation.detail["failures"])
    sheet = keep_contact_sheet(store, generation.id, worlds)
    return sheet_markdown(sheet, f"{store.url}/{contact_sheet_key(generation.id)}", failures)


def draw_imported(store_url: str, worlds: Sequence[str]) -> str:
    """Returns a page, as Markdown, with an imported world, or its variants side by side; keeps their picture.

    Args:
        store_url: Where they are.
        worlds: ``<generation>/<world>`` of each, at least one, all of one generation.
    """
    store, generation = open_store(store_url), worlds[0].partition("/")[0]
    sheet = keep_contact_sheet(store, generation, worlds)
    return sheet_markdown(sheet, f"{store.url}/{contact_sheet_key(generation)}", {})
