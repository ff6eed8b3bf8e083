"""Makes a batch's report from its tables and worlds: an HTML page that loads nothing, a picture, and Markdown.

Whatever a document or an application names (worlds, variables, reasons) is escaped, and the page's own policy forbids
scripts and requests besides. Prefect's pages show the picture and the Markdown.
"""

import functools
import hashlib
import logging
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from pydantic import BaseModel, ConfigDict, ValidationError

from specs.data.outcomes import MARKS
from specs.data.world import FloorZone, Room, Start
from specs.errors import ObjectNotFound, WorldChanged
from specs.field_types import OutputLocation
from specs.untrusted_text import escape_markdown, xml_text
from tasks.results.report.batch_facts import BatchFacts
from tasks.results.report.last_pictures import last_seen, no_pictures
from tasks.results.report.rate_tables import RateRow, RateTable
from tasks.results.report.report_columns import DrivenWorlds
from tasks.results.report.report_view import ReportView, RoomsView, report_view
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE, require_as_written
from tasks.storage.base.keys import checked_name, output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.worlds import decode_world, pinned_world_bytes, world_bytes


def report_page(view: ReportView) -> bytes:
    """Returns the page, the same bytes for the same view."""
    return page_templates().get_template("report.html.j2").render(view=view, styles=report_styles()).encode()


def report_styles() -> str:
    """Returns the page's CSS, with the colours of all marks."""
    return page_templates().get_template("report.css").render().rstrip()


def report_picture(view: ReportView) -> bytes:
    """Returns the rate with its interval and the first map as one SVG image, for where no page can stand."""
    return page_templates().get_template("picture.svg.j2").render(view=view).encode()


@functools.cache
def page_templates(package: str = "tasks.results.report") -> Environment:
    """Returns the templates of a package's pages, which escape whatever they are given."""
    found = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_fit,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    cast("dict[str, Any]", found.globals).update(marks=MARKS, colors=_colors)
    return found


def _colors(ground: str) -> str:
    """Returns the CSS variables of all marks on a ground: ``light``, ``dark`` or ``paper``."""
    return "; ".join(f"--{mark.name}: {getattr(mark, ground)}" for mark in MARKS)


def _fit(value: object) -> object:
    """Returns a text as a page may hold it; no line begins with the sign of a percentage."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return _PERCENT.sub("\u00a0%", xml_text(value))
    return value


_PERCENT = re.compile(r"(?<=[0-9]) %")


_VERDICT_MARKS = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_HEAD = ("group", "passed", "rate", "interval", "why not")


def report_markdown(view: ReportView, url: str) -> str:
    """Returns the verdict, the rates and the reasons, and where the page is."""
    judged = view.facts.judgement
    title = f"# {_VERDICT_MARKS[judged.verdict]} {judged.verdict}" if judged else "# Not judged"
    said = judged.sentence.splitlines() if judged else ["No gate has judged this batch."]
    sentence = "\n".join([escape_markdown(said[0]), *(f"- {escape_markdown(line)}" for line in said[1:])])
    rows = [
        view.whole,
        *(row for column in view.columns for table in column for row in _captioned_rows(table)),
    ]
    rate = [f"{view.judged.text}.", *view.like_these.sentences()]
    reasons = [f"- {row.count:,} x {escape_markdown(row.reason)} ({row.share} of failures)" for row in view.reasons]
    return "\n\n".join(
        [
            *(title, sentence, escape_markdown(" ".join(rate)), _table(rows), escape_markdown(_intervals(view))),
            "\n".join(reasons) or "No failures.",
            *([_rooms_markdown(view.rooms)] if view.rooms else []),
            f"Report: {escape_markdown(url)}",
        ]
    )


def _rooms_markdown(rooms: RoomsView) -> str:
    line = escape_markdown(f"{rooms.line[0].upper()}{rooms.line[1:]}.")
    return "\n".join([line, *(f"- ⚠️ {escape_markdown(warning)}" for warning in rooms.warnings)])


def _intervals(view: ReportView) -> str:
    said = f"Rates {view.where}, that of a world in it alone; {view.confidence} intervals."
    return f"{said} {view.family.sentence()}." if view.family.size else said


def _captioned_rows(table: RateTable) -> list[RateRow]:
    caption = table.caption.removeprefix("By ")
    return [row.model_copy(update={"label": f"{caption}: {row.label}"}) for row in table.rows]


def _table(rows: Sequence[RateRow]) -> str:
    lines = [(row.label, row.counts, row.rate, row.interval, row.why) for row in rows]
    return "\n".join(
        [
            _line(_HEAD),
            _line(["---"] * len(_HEAD)),
            *(_line([escape_markdown(cell) for cell in line]) for line in lines),
        ]
    )


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


logger = logging.getLogger(__name__)
REPORT_FILE = "report.html"
# Reading so many takes a second or two; of more, rooms and maps are told of the first ones alone.
MOST_WORLDS_READ = 2_000


class _Rooms(BaseModel):
    """The part of a world that is wanted of every one; all of them as a whole would fill the memory."""

    model_config = ConfigDict(extra="ignore")

    rooms: tuple[Room, ...]
    zones: tuple[FloorZone, ...] | None = None
    start: Start | None = None


def batch_view(store: Store, facts: BatchFacts, location: OutputLocation) -> ReportView:
    """Returns what a batch's report shows.

    Args:
        store: The store of the batch.
        facts: What its records say.
        location: Where its tables lie.

    Raises:
        ObjectNotFound: A table is gone.
        StageFailed: A table is not the one that the batch wrote, whose SHA-256 the page names.
        StoreError: The store or the bucket cannot be read.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    with tempfile.TemporaryDirectory(prefix="simyard-report-") as folder:
        results, failures = Path(folder) / RESULTS_FILE, Path(folder) / FAILURES_FILE
        for path in (results, failures):
            key = file_key(location, facts.batch, path.name)
            bucket.download(key, path)
            _require_as_written(path, facts, f"{bucket.url}/{key}")
        seen = last_seen(bucket, location, facts.batch, Path(folder)) if facts.pictures else no_pictures
        return report_view(facts, results, failures, stored_worlds(store, facts), seen)


def put_report(store: Store, location: OutputLocation, batch: str, page: bytes) -> str:
    """Writes the page beside the batch's tables, and returns its URL.

    Args:
        store: The store of the batch.
        location: Where its tables lie.
        batch: The batch's id.
        page: The page.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    key = file_key(location, batch, REPORT_FILE)
    bucket.put(key, page)
    return f"{bucket.url}/{key}"


def file_key(location: OutputLocation, batch: str, name: str) -> str:
    """Returns the key of one of a batch's files in its bucket."""
    return output_key(location.s3Prefix, f"{checked_name(batch, 'batch')}/{name}")


def stored_worlds(store: Store, facts: BatchFacts) -> DrivenWorlds:
    """Returns a batch's worlds, without those that are gone or no longer what the batch ran in."""
    found = {name: _rooms(store, name, digest) for name, digest in list(facts.worlds.items())[:MOST_WORLDS_READ]}
    read = {name: each for name, each in found.items() if each is not None}
    return DrivenWorlds(
        {name: each.rooms or each.zones or () for name, each in read.items()},
        lambda name: decode_world(world_bytes(store, name)),
        {name: (each.start.x_m, each.start.y_m) for name, each in read.items() if each.start},
    )


def _require_as_written(path: Path, facts: BatchFacts, url: str) -> None:
    named = next((link.sha256 for link in facts.links if link.label == path.name), "")
    if named:
        with path.open("rb") as file:
            require_as_written(hashlib.file_digest(file, "sha256").hexdigest(), named, url)


def _rooms(store: Store, name: str, digest: str) -> _Rooms | None:
    try:
        return _Rooms.model_validate_json(pinned_world_bytes(store, name, digest))
    except (ObjectNotFound, ValidationError) as exc:
        logger.warning("world %s is left out of the report: %s", name, exc)
    except WorldChanged:
        logger.warning("world %s is left out of the report: it is not the one that the batch ran in", name)
    return None
