"""A document's trend: what it shows, its page beside the batches' folders, and the alarms that a run has raised."""

import logging
from datetime import UTC, datetime
from typing import NamedTuple

from flows.trend.history import History, document_names, read_history
from specs.base import Fault
from specs.errors import DocumentError, SimyardError
from specs.field_types import OutputLocation
from tasks.results.statistics.change_point import NIGHTS_A_YEAR
from tasks.results.trend.measure import Measure
from tasks.results.trend.page import trend_page
from tasks.results.trend.series import Choice, Trend, make_trend, raised_alarms
from tasks.results.trend.view import Alarm, TrendView, alarm_of, trend_view
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.keys import output_key, trend_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.runs import run_document

logger = logging.getLogger(__name__)


class TrendAsked(NamedTuple):
    """What is asked for.

    Attributes:
        document: The document's name; empty for the only one.
        measure: What is counted of each episode.
        choice: Which episodes are looked at.
        last: How many nights are shown; 0 for all.
        since_s: The first time that is shown, seconds since 1970.
        anew: Whether nothing is taken from the cache folder.
    """

    document: str = ""
    measure: Measure = Measure()
    choice: Choice = Choice()
    last: int = 0
    since_s: float = 0.0
    anew: bool = False


class WrittenTrend(NamedTuple):
    """A page that was written, and the alarms that were first seen at the end of the run's batch."""

    url: str
    alarms: tuple[Alarm, ...]


def find_trend(store: Store, asked: TrendAsked, *, base: str = "") -> TrendView:
    """Returns what is shown of a document's nights.

    Args:
        store: Where its runs are.
        asked: What is asked for.
        base: URL of the folder that the page's relative links start from; empty if all links are whole.

    Raises:
        DocumentError: There is no such document, or no such episode.
    """
    document = asked.document or _only_document(store)
    history = read_history(store, document, asked.measure, anew=asked.anew)
    if not history.nights:
        raise _unknown_document(store, document)
    return _view(make_trend(history.nights, asked.choice), history, asked._replace(document=document), base)


def write_trend_of_run(store: Store, run: JobRecord, batch: JobRecord) -> WrittenTrend | None:
    """Writes the trend of a run's document; returns where, and the alarms that this run's batch has raised.

    A trend decides nothing: if it cannot be made, the log says why, and None is returned.

    Args:
        store: Where the run is.
        run: The run of a document.
        batch: Its batch, which has ended.
    """
    try:
        return _write(store, run_document(run), run.id, recorded_location(batch))
    except SimyardError as exc:
        logger.warning("no trend was written: %s", exc)
    except Exception:
        logger.exception("no trend was written: this is a defect of Simyard")
    return None


def _write(store: Store, document: str, run: str, place: OutputLocation) -> WrittenTrend:
    bucket = open_bucket(store, place.s3Bucket or "")
    key = output_key(place.s3Prefix, trend_key(document))
    base = f"{bucket.url}/{key}".removesuffix(f"/{trend_key(document)}")
    asked = TrendAsked(document)
    history = read_history(store, document, asked.measure)
    trend = make_trend(history.nights, asked.choice)
    bucket.put(key, trend_page(_view(trend, history, asked, base)))
    raised = raised_alarms(trend, asked.choice, run)
    return WrittenTrend(f"{bucket.url}/{key}", tuple(alarm_of(trend, each, change) for each, change in raised))


def _view(trend: Trend, history: History, asked: TrendAsked, base: str) -> TrendView:
    shown = [at for at, night in enumerate(trend.nights) if night.begun_at_s >= asked.since_s]
    if not shown:
        day = datetime.fromtimestamp(asked.since_s, tz=UTC).date().isoformat()
        raise DocumentError([Fault(path="--since", value=day, allowed="a day with a night on it or after it")])
    first = max(shown[0], len(trend.nights) - asked.last if asked.last else 0)
    choice = asked.choice
    parts = [
        f"world {choice.world}" if choice.world else "",
        f"version {choice.version}" if choice.version else "",
        *(f"{name} = {value}" for name, value in choice.variables),
    ]
    return trend_view(
        trend,
        document=asked.document,
        words=asked.measure.words(history.at_most),
        chosen=", ".join(filter(None, parts)),
        first=first,
        base=base,
        limit=NIGHTS_A_YEAR,
    )


def _only_document(store: Store) -> str:
    names = document_names(store)
    if len(names) == 1:
        return names[0]
    allowed = f"one of {', '.join(names[:20])}" if names else "a document that has been run in this store"
    raise DocumentError([Fault(path="DOCUMENT-NAME", value="not given", allowed=allowed)], source="simyard")


def _unknown_document(store: Store, document: str) -> DocumentError:
    names = document_names(store)
    allowed = "a document with a batch that has ended"
    if document not in names:
        allowed += f"; the documents of this store are {', '.join(names[:20])}" if names else "; this store has none"
    return DocumentError([Fault(path="DOCUMENT-NAME", value=repr(document), allowed=allowed)], source="simyard")
