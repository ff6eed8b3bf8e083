"""Renders a report: as one HTML page that loads and runs nothing, as one picture, and in short as Markdown.

Whatever a document or an application names (worlds, variables, reasons) is escaped, and the page's own policy forbids
scripts and requests besides. Prefect's pages show the picture and the Markdown.
"""

import functools
from collections.abc import Sequence
from typing import Any, cast

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from specs.artifact_text import escape_markdown, xml_text
from specs.data.outcome_reasons import MARKS
from tasks.results.report.rows import RateRow, RateTable
from tasks.results.report.view import ReportView, RoomsView


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
    return xml_text(value) if isinstance(value, str) and not isinstance(value, Markup) else value


_MARKS = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_HEAD = ("group", "passed", "rate", "interval", "why not")


def report_markdown(view: ReportView, url: str) -> str:
    """Returns the verdict, the rates and the reasons, and where the page is."""
    judged = view.facts.judgement
    title = f"# {_MARKS[judged.verdict]} {judged.verdict}" if judged else "# Not judged"
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
            *([_rooms(view.rooms)] if view.rooms else []),
            f"Report: {escape_markdown(url)}",
        ]
    )


def _rooms(rooms: RoomsView) -> str:
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
