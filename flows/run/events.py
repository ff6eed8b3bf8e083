"""Prefect events for automations: one for each change of a job's status, and for each verdict of a gate.

An event is sent when the change is in the store. Its id is made from the job and the status, so that a second sending
of the same change is dropped by the server.
"""

import logging
from collections.abc import Generator
from contextlib import contextmanager
from uuid import NAMESPACE_URL, UUID, uuid5

from prefect.events import emit_event

from flows.gate.judge import GateAnswer
from flows.run.log_page import log_on_page
from specs.arn import resource_name
from specs.job_kinds import JOB_KINDS
from tasks.progress.log_lines import log_in_chosen_format
from tasks.results.trend.view import Alarm
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.transitions import Transition, listen_to_transitions

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


def _announce(change: Transition) -> None:
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
