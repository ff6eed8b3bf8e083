"""The tags that applications give to their own jobs while they are simulated, on their way to whoever keeps them.

They are no part of a row. Whoever simulates without a wish for tags, such as an audit, loses nothing by leaving them.
"""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

JobTags = dict[int, dict[str, str]]
"""Tags by the index of the episode."""

_collecting: ContextVar[JobTags | None] = ContextVar("simyard_job_tags", default=None)


@contextmanager
def collect_tags() -> Generator[JobTags, None, None]:
    """Yields what gets all tags that are given inside the ``with`` block."""
    tags: JobTags = {}
    token = _collecting.set(tags)
    try:
        yield tags
    finally:
        _collecting.reset(token)


def give_tags(index: int, tags: Mapping[str, str]) -> None:
    """Adds the tags of an episode's job to what is collected, if anybody collects."""
    collecting = _collecting.get()
    if collecting is not None and tags:
        collecting.setdefault(index, {}).update(tags)
