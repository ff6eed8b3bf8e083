"""What Prefect hears of a run: its log lines, an event for each change of a status or verdict, and its assets.

An event is sent when the change is in the store. Its id is made from the job and the status, so that a second sending
of the same change is dropped by the server. Prefect's own `@materialize` would give each event a new id, so that a run
that was killed and continued would say all twice (docs/reference/prefect.md, section 9).

Prefect reads PREFECT_LOGGING_EXTRA_LOGGERS when it is imported, and a worker imports it before Simyard. So a flow adds
the handler of log lines itself, as the setting would.
"""

import hashlib
import logging
from collections.abc import Generator
from contextlib import contextmanager
from threading import Lock
from urllib.parse import urlsplit
from uuid import NAMESPACE_URL, UUID, uuid5

import prefect.assets as prefect_assets
from prefect.assets import AssetProperties
from prefect.context import AssetContext, FlowRunContext, TaskRunContext
from prefect.events import emit_event
from prefect.logging.handlers import APILogHandler, PrefectConsoleHandler
from prefect.types.names import MAX_ASSET_KEY_LENGTH, RESTRICTED_ASSET_CHARACTERS

from flows.pipeline.run_gate import GateAnswer
from flows.pipeline.stage_report import Asset, MadeAsset
from specs.arn import resource_name
from specs.base import canonical_json
from specs.job_kinds import JOB_KINDS
from tasks.progress.log_lines import LOGGERS, chosen_log_format, log_in_chosen_format
from tasks.results.trend.trend_view import Alarm
from tasks.storage.jobs.records import JobRecord, JobTransition, listen_to_transitions

# Prefect gives the loggers of PREFECT_LOGGING_EXTRA_LOGGERS what it gives this one, but for the level.
_PREFECTS_EXTRA = "prefect.extra"
_turn = Lock()
_blocks = 0
_undo: list[tuple[logging.Logger, int, logging.Handler | None]] = []


@contextmanager
def log_on_page() -> Generator[None, None, None]:
    """Sends what Simyard logs inside the ``with`` block to the page of the flow or task run that it is in.

    The level is PREFECT_LOGGING_LEVEL, where nobody chose one for Simyard's loggers. Blocks may be nested, and lie in
    several threads.
    """
    _begin_logging()
    try:
        yield
    finally:
        _end_logging()


def _begin_logging() -> None:
    global _blocks  # noqa: PLW0603 - loggers are the process's, and so is who needs their handlers
    written = chosen_log_format() is not None  # a format that there is not is refused before anything is changed
    with _turn:
        _blocks += 1
        if _blocks > 1:
            return
        level = logging.getLogger(_PREFECTS_EXTRA).getEffectiveLevel()
        for logger in map(logging.getLogger, LOGGERS):
            handler = None if any(isinstance(each, APILogHandler) for each in logger.handlers) else _handler()
            _undo.append((logger, logger.level, handler))
            if handler:
                logger.addHandler(handler)
            if logger.level == logging.NOTSET:
                logger.setLevel(level)
        if written:
            _spare_console()


def _end_logging() -> None:
    global _blocks  # noqa: PLW0603 - same
    with _turn:
        _blocks -= 1
        if _blocks:
            return
        for logger, level, handler in _undo:
            logger.setLevel(level)
            if handler:
                logger.removeHandler(handler)
        _undo.clear()


def _handler() -> logging.Handler:
    handler = APILogHandler()
    handler.addFilter(_is_in_a_run)
    return handler


def _is_in_a_run(_record: logging.LogRecord) -> bool:
    """Returns whether a line has a page: outside of runs the handler would only warn that it has none."""
    return FlowRunContext.get() is not None or TaskRunContext.get() is not None


def _spare_console() -> None:
    """Has Prefect's console leave out what SIMYARD_LOG_FORMAT writes to stderr already, as one line for a program."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, PrefectConsoleHandler) and _is_of_others not in handler.filters:
            handler.addFilter(_is_of_others)


def _is_of_others(record: logging.LogRecord) -> bool:
    return not chosen_log_format() or record.name.split(".")[0] not in LOGGERS


logger = logging.getLogger(__name__)


@contextmanager
def announce_changes() -> Generator[None, None, None]:
    """Sends an event for each job whose status changes inside the ``with`` block, which runs in a flow or a task.

    Also what the block logs is on the page of its run, and is written as SIMYARD_LOG_FORMAT asks, if it does.
    """
    with log_in_chosen_format(), log_on_page(), listen_to_transitions(_announce):
        yield


def announce_verdict(answer: GateAnswer, run: JobRecord, batch: JobRecord) -> None:
    """Sends the event of a gate's verdict, such as ``simyard.gate.FAIL``, once the run's record has it."""
    facts = {"sentence": answer.sentence, "evidence": answer.evidence_url, "batch": batch.arn}
    _send(f"simyard.gate.{answer.verdict}", run.arn, facts)


def announce_alarm(alarm: Alarm, url: str) -> None:
    """Sends the event of a change of a document's rate, such as ``simyard.trend.Fell``, by the run that raised it.

    The resource is the batch at whose end it was seen.
    """
    event = f"simyard.trend.{'Fell' if alarm.fell else 'Rose'}"
    facts = {"sentence": alarm.sentence, "series": alarm.series, "began": alarm.began, "bundle": alarm.bundle}
    _send(event, alarm.seen, {**facts, "page": url}, key=f"{event} {alarm.series}")


def event_id(event: str, arn: str) -> UUID:
    """Returns the id of an event about a job: the same whoever sends it, and however often."""
    return uuid5(NAMESPACE_URL, f"{arn}#{event}")


def _announce(change: JobTransition) -> None:
    """Sends a change, unless it is of the run that a stage alone is recorded as: its job's change says as much."""
    event = JOB_KINDS[change.kind].event
    if change.flow and change.flow != event:
        return
    facts = {"was": change.was, "failureCode": change.failure_code, "failureReason": change.failure_reason}
    _send(f"simyard.{event}.{change.status}", change.arn, facts)


def _send(event: str, arn: str, facts: dict[str, str], key: str = "") -> None:
    resource = {"prefect.resource.id": arn, "prefect.resource.name": resource_name(arn)}
    payload = {name: value for name, value in facts.items() if value}
    try:  # Prefect adds the flow run that this is in, with its deployment and tags, as related resources
        emit_event(event, resource, payload=payload, id=event_id(key or event, arn))
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the job goes on
        logger.warning("no event was sent that %s: %s", event, exc)


MATERIALIZED = "prefect.asset.materialization.succeeded"
REFERENCED = "prefect.asset.referenced"
_MAKER = "simyard"
_PLAIN = str.maketrans(dict.fromkeys(RESTRICTED_ASSET_CHARACTERS, "_"))
_DIGEST_DIGITS = 16


# Prefect's own `@materialize` names its assets before the task runs, and gives each event a new id, so that a run
# that was killed and continued would say all twice. Here the keys are URLs of what was made, and ids are made of
# them: the server drops what it has (docs/reference/prefect.md, section 9).
def announce_asset(made: MadeAsset) -> None:
    """Sends the events of something that was made: one for each of its sources, and one for itself."""
    sources = [_prefect_asset(each) for each in made.sources]
    try:
        own = _prefect_asset(made.asset)
        for source in sources:
            resource = AssetContext.asset_as_resource(source)
            emit_event(REFERENCED, resource, related=[], id=event_id(REFERENCED, f"{source.key}#{own.key}"))
        emit_event(
            MATERIALIZED,
            AssetContext.asset_as_resource(own),
            related=[*map(AssetContext.asset_as_related, sources), AssetContext.related_materialized_by(_MAKER)],
            payload=made.facts,
            # With the figures: a second verdict on a batch is in the same place as the first.
            id=event_id(MATERIALIZED, f"{own.key}#{canonical_json(made.facts).decode()}"),
        )
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the job goes on
        logger.warning("no event was sent that %s was made: %s", made.asset.name, exc)


def asset_key(url: str) -> str:
    """Returns the key of what is at a URL of a store: the URL, without what Prefect forbids in keys, and secrets.

    A key that is not the URL itself ends in a digest, so that no two URLs have the same key.
    """
    parts = urlsplit(url)
    plain = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    key = plain.translate(_PLAIN)
    if key == url and len(key) <= MAX_ASSET_KEY_LENGTH:
        return key
    digest = hashlib.sha256(plain.encode()).hexdigest()[:_DIGEST_DIGITS]
    return f"{key[: MAX_ASSET_KEY_LENGTH - _DIGEST_DIGITS - 1]}-{digest}"


def _prefect_asset(asset: Asset) -> prefect_assets.Asset:
    return prefect_assets.Asset(key=asset_key(asset.url), properties=AssetProperties(name=asset.name))
