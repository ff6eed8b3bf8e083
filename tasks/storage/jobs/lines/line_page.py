"""A page of the jobs of a kind, from their lines."""

from collections.abc import Iterator, Mapping

from pydantic import JsonValue

from specs.field_types import FilteredPage, Page
from specs.job_kinds import JobKind
from specs.robomaker.list_pages import Place, page_of, page_size, place_after, wanted_values
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.job_lines import START, JobLines, LineOf, Wanted
from tasks.storage.jobs.lines.marks import Mark
from tasks.storage.jobs.lines.segments import Line

Summaries = tuple[dict[str, JsonValue], ...]
_PLACE = (int, str)


def line_page(
    store: Store,
    kind: JobKind,
    line_of: LineOf,
    request: Page,
    *,
    most: int,
    filters: Mapping[str, str],
    only: Wanted | None = None,
) -> tuple[Summaries, str | None]:
    """Returns the summaries of a page of jobs, oldest first, and the token of the next one.

    Args:
        store: Where they are.
        kind: Of the jobs.
        line_of: Makes the line of one from its record.
        request: The List call's.
        most: How many a page has at most.
        filters: The names that the call filters by, each with the name of the lines' values.
        only: What else a line must have.

    Raises:
        DocumentError: The request has a token, a size or filters that the call does not take.
    """
    asked = wanted_values(request, filters) if isinstance(request, FilteredPage) else {}
    wanted = {**(only or {}), **{filters[name]: values for name, values in asked.items()}}
    size, after = page_size(request, most), place_after(request, kind, _PLACE)
    lines = JobLines(store, kind, line_of)
    page = page_of(_summaries(lines, _mark(after), wanted), size, kind)
    lines.settle()
    return page


def all_lines(store: Store, kind: JobKind, line_of: LineOf, only: Wanted | None = None) -> Iterator[Line]:
    """Yields the lines of all jobs of a kind, oldest first."""
    lines = JobLines(store, kind, line_of)
    for found in lines.found(START, only):
        line = lines.line(found)
        if line and fits(line, only or {}):
            yield line
    lines.settle()


def fits(line: Line, wanted: Wanted) -> bool:
    """Returns whether a line has one of the wanted values, of each name."""
    return all(not set(line.values.get(name, ())).isdisjoint(values) for name, values in wanted.items())


def _summaries(lines: JobLines, after: Mark | None, wanted: Wanted) -> Iterator[tuple[Place, dict[str, JsonValue]]]:
    for found in lines.found(after or START, wanted):
        if after is None or found.mark > after:
            line = lines.line(found)
            if line and fits(line, wanted):
                yield line.mark, line.summary


def _mark(place: Place | None) -> Mark | None:
    return Mark(int(place[0]), str(place[1])) if place else None
