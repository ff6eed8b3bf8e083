"""A document's nights for Python: `trend`. It imports what it needs when it is called."""
# ruff: noqa: PLC0415 - see above

import os
from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simyard.answer.trend import Trend


def trend(
    document: str = "",
    *,
    measure: str = "success",
    world: str = "",
    version: str = "",
    variables: Mapping[str, str] | None = None,
    since: datetime | None = None,
    last: int = 0,
    store: str | os.PathLike[str] | None = None,
) -> "Trend":
    """Returns a document's rates night by night, and where they changed.

    Args:
        document: Its name; left out, the store's only one.
        measure: `success`, `collision`, or a column and a quantile, such as `simulated_s:0.95`.
        world: Only episodes in this world.
        version: Only episodes of this version, or of the bundle with this digest.
        variables: Only episodes with these values.
        since: The first time to show.
        last: How many nights to show; 0 for all.
        store: `file:///folder`, `s3://bucket/prefix` or a folder; SIMYARD_STORE, else `.simyard` in the working
            directory.

    Raises:
        DocumentError: There is no such document, or measure.
    """
    from flows.trend.trend_page import TrendAsked, find_trend
    from simyard.answer.trend import Trend
    from simyard.store_place import store_url
    from tasks.results.trend.measure import parse_measure
    from tasks.results.trend.page import trend_page
    from tasks.results.trend.series import Choice
    from tasks.storage.store_url import open_existing_store

    choice = Choice(world, version, tuple((variables or {}).items()))
    since_s = since.timestamp() if since else 0.0
    asked = TrendAsked(document=document, measure=parse_measure(measure), choice=choice, last=last, since_s=since_s)
    view = find_trend(open_existing_store(store_url(store)), asked)
    return Trend(view, trend_page(view))
