"""Each step as a task of Prefect's, named like the step: with a name on Prefect's pages, progress and artifacts.

A step that is run again finds what it did before by its client request token, so that nothing is done twice. Prefect's
cache and its transactions would remember the same on the side of its server, which may forget, and which other ways
into Simyard do not ask; so they are not used (docs/reference/prefect.md, section 7).
"""

import functools
import inspect
import logging
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, ParamSpec, Protocol, TypeVar, cast
from uuid import UUID

from httpx import TransportError
from prefect import Task, task
from prefect.artifacts import (
    create_markdown_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)
from prefect.cache_policies import NO_CACHE
from prefect.context import SettingsContext, get_settings_context
from prefect.exceptions import PrefectHTTPStatusError
from prefect.settings import PREFECT_CLIENT_MAX_RETRIES, temporary_settings
from pydantic import JsonValue

from flows.batch import batch_steps
from flows.batch import search_batch as search_steps
from flows.batch.batch_steps import BatchTables
from flows.batch.search_batch import SearchResult
from flows.pipeline import run_gate
from flows.pipeline.run_gate import BatchJudgement
from specs.arn import resource_name
from specs.data.parity_audit import AuditReport, AuditVerdict
from specs.data.run_report import Verdict
from specs.errors import StoreAway
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.world_jobs import CreateWorldExportJobRequest, CreateWorldGenerationJobRequest
from specs.untrusted_text import escape_markdown, table_rows
from tasks.applications import step as application_step
from tasks.deploy import step as deploy_step
from tasks.deploy.fleet_descriptions import deployment_sentence, robot_rows, view_deployment
from tasks.export import step as export_step
from tasks.progress.listener import (
    Progress,
    current_listener,
    document_artifact_key,
    listen_to_progress,
    stage_progress,
)
from tasks.simulate.batch.batch_record import load_batch
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tasks.worlds import step as world_step

P = ParamSpec("P")
R = TypeVar("R")
Parameters = Mapping[str, Any]
RETRY_DELAYS_S = (5.0, 20.0, 60.0)
_HEADINGS = ("episodes", "passed", "rate", "interval", "why not")
_VERDICT_MARKS: Mapping[Verdict, str] = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_AUDIT_MARKS: Mapping[AuditVerdict, str] = {"SOUND": "✅", "SUSPECT": "❌", "NOT COMPARED": "❔", "NOT RUN": "❔"}
# A page with more lines is read by nobody; the tables have them all.
_ROWS_SHOWN = 200
# `--watch` prints every update, and each is a request to the server.
_INTERVAL_S = 1.0
_INTERVAL_AWAY_S = 10.0
logger = logging.getLogger(__name__)


class _EndState(Protocol):
    """A state of Prefect's, with what its task raised."""

    data: Any


def is_store_away(_task: object, _task_run: object, state: _EndState) -> bool:
    """Returns whether a task failed because its store did not answer; Prefect calls it before it runs a task again."""
    return isinstance(state.data, StoreAway)


TASK_OPTIONS: dict[str, Any] = {
    "cache_policy": NO_CACHE,  # a repeated step is recognised by its token, in the store
    "persist_result": False,
    "retries": len(RETRY_DELAYS_S),
    "retry_delay_seconds": [*RETRY_DELAYS_S],
    "retry_condition_fn": is_store_away,
}
"""Options of every task: it runs again if the store was away, and never for a fault of a document."""


def named_by(name: Callable[[Parameters], str]) -> Callable[[], str]:
    """Returns a function that names a task run by its parameters, as Prefect's types have it.

    Prefect hands the parameters to a function that has an argument ``parameters``; its types say so of objects only.
    """
    return cast("Callable[[], str]", name)


def as_task(
    step: Callable[P, R],
    run_name: str | Callable[[Parameters], str],
    *,
    name: str = "",
    progress: tuple[str, str] | None = None,
    show: Callable[[Parameters, R], None] | None = None,
) -> Task[P, R]:
    """Returns a step as a task of Prefect's, which has the step's name and parameters.

    Args:
        step: A plain function of data.
        run_name: What Prefect's pages call a run of it; or what makes that of the parameters.
        name: What they call the task; the step's name with dashes, if it is left out.
        progress: What a person calls the stage that the step tells the progress of, and the key of its artifact.
        show: Leaves artifacts, given the parameters and what the step returned.
    """

    @functools.wraps(step)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        shown: AbstractContextManager[object] = show_progress(*progress) if progress else nullcontext()
        with shown:
            result = step(*args, **kwargs)
        if show:
            show(inspect.signature(step).bind(*args, **kwargs).arguments, result)
        return result

    name = name or step.__name__.replace("_", "-")
    chosen = run_name if isinstance(run_name, str) else named_by(run_name)
    return task(name=name, task_run_name=chosen, **TASK_OPTIONS)(run)


# Worlds and their export.


def worlds_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run of a generation, such as ``worlds 51-100``."""
    request: CreateWorldGenerationJobRequest = parameters["request"]
    count = (request.worldCount.floorplanCount or 1) * (request.worldCount.interiorCountPerFloorplan or 1)
    # Of several jobs, all have as many interiors of each plan or are interiors of one plan.
    plan, interior = parameters.get("first", (1, 1))
    before = (plan - 1) * (request.worldCount.interiorCountPerFloorplan or 1) + interior - 1
    return f"worlds {before + 1}-{before + count}" if count > 1 else f"world {before + 1}"


def export_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run of an export, such as ``export 8 worlds``."""
    request: CreateWorldExportJobRequest = parameters["request"]
    return f"export {len(request.worlds)} world{'' if len(request.worlds) == 1 else 's'}"


def _show_worlds(parameters: Parameters, page: str) -> None:
    generation: JobRecord = parameters["generation"]
    worlds = cast("list[str]", generation.detail["worlds"])
    create_markdown_artifact(
        page, key=document_artifact_key("worlds"), description=f"{len(worlds)} worlds of {generation.id}"
    )


def _show_imported(parameters: Parameters, page: str) -> None:
    create_markdown_artifact(
        page, key=document_artifact_key("imported-world"), description=f"Imported: {', '.join(parameters['worlds'])}"
    )


def imported_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run that draws an imported world."""
    return f"draw {parameters['worlds'][0].rpartition('/')[2]}"


generate_worlds = as_task(world_step.generate_worlds, worlds_name, progress=(world_step.STAGE, "worlds-progress"))
draw_worlds = as_task(export_step.draw_worlds, "contact sheet", name="show-worlds", show=_show_worlds)
draw_imported = as_task(export_step.draw_imported, imported_name, name="show-imported", show=_show_imported)
export_worlds = as_task(export_step.export_worlds, export_name, progress=(export_step.STAGE, "export-progress"))


# The batch and its gate.


def unpack_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run of an application that is unpacked, such as ``unpack courier``."""
    return f"unpack {parameters['name'] or parameters['digest'][:12]}"


def chunk_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run of a chunk, such as ``chunk 3 of 16``."""
    chunk = f"chunk {parameters['number'] + 1}"
    try:
        return f"{chunk} of {_chunks(parameters['store_url'], parameters['batch'])}"
    except StoreAway:  # Prefect asks before it runs the task, which would not be run again for it
        return chunk


@functools.lru_cache(maxsize=8)
def _chunks(store_url: str, batch: str) -> int:
    return load_batch(open_store(store_url), batch).layout.chunks


def _show_tables(parameters: Parameters, tables: BatchTables) -> None:
    rows: list[dict[str, JsonValue]] = [dict(zip(_HEADINGS, row, strict=True)) for row in tables.rows[:_ROWS_SHOWN]]
    said = f"Results of {parameters['batch']}. {tables.note}."
    create_table_artifact(key=document_artifact_key("batch-results"), table=table_rows(rows), description=said)


def _show_audit(_parameters: Parameters, detail: dict[str, JsonValue]) -> None:
    report = AuditReport.model_validate(detail["audit"])
    said = escape_markdown(report.sentence)
    body = f"# {_AUDIT_MARKS[report.verdict]} {report.verdict}\n\n{said}\n\nReport: `{detail['audit_url']}`"
    create_markdown_artifact(body, key=document_artifact_key("parity-audit"))


def show_search(result: SearchResult) -> None:
    """Leaves what a search came to as an artifact."""
    found = result.found
    shown = (f"{each.reason}: {each.circumstances}; on C MuJoCo: {each.on_reference}" for each in found.numbered)
    lines = [f"- {escape_markdown(each)}" for each in shown]
    said = f"{found.probability.sentence}; {found.findings}"
    body = "\n".join([f"# Search\n\n{escape_markdown(said)}\n", *lines])
    create_markdown_artifact(body, key=document_artifact_key("search"))


def _show_verdict(_parameters: Parameters, judged: BatchJudgement) -> None:
    verdict = judged.verdict
    body = "\n".join(f"- {escape_markdown(f'{each.title}: {each.sentence}')}" for each in verdict.rules)
    page = f"# {_VERDICT_MARKS[verdict.verdict]} {verdict.verdict}\n\n{body}\n\nEvidence: `{judged.url}`"
    create_markdown_artifact(page, key=document_artifact_key("gate"))


unpack_application = as_task(application_step.unpack_application, unpack_name)
simulate_chunk = as_task(batch_steps.simulate_chunk, chunk_name)
write_tables = as_task(batch_steps.write_tables, "tables", name="write-results", show=_show_tables)
audit_batch = as_task(
    batch_steps.audit_batch, "audit", progress=(batch_steps.AUDIT, "audit-progress"), show=_show_audit
)
search_batch = as_task(
    search_steps.search_batch,
    "search",
    progress=(search_steps.STAGE, "search-progress"),
    show=lambda _parameters, result: show_search(result),
)
judge_batch = as_task(run_gate.judge_batch, "judge", name="judge", show=_show_verdict)


# The roll-out.


def roll_out_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run of a roll-out, such as ``roll out to couriers``."""
    request: CreateDeploymentJobRequest = parameters["request"]
    return f"roll out to {resource_name(request.fleet)}"


def sync_name(parameters: Parameters) -> str:
    """Returns what Prefect's pages call the task run of a sync, such as ``sync couriers``."""
    return f"sync {resource_name(parameters['fleet'])}"


def _show_robots(parameters: Parameters, record: JobRecord) -> None:
    view = view_deployment(open_store(parameters["store_url"]), record.id)
    rows, said = table_rows(robot_rows(view)), escape_markdown(deployment_sentence(view))
    create_table_artifact(rows, key=document_artifact_key("deployment-robots"), description=said)


_DEPLOYMENT = (deploy_step.STAGE, "deployment-progress")
roll_out = as_task(deploy_step.roll_out, roll_out_name, progress=_DEPLOYMENT, show=_show_robots)
deploy_version = as_task(deploy_step.deploy_version, roll_out_name, progress=_DEPLOYMENT, show=_show_robots)
sync_fleet = as_task(deploy_step.sync_fleet, sync_name, progress=_DEPLOYMENT, show=_show_robots)


# Progress: bars that move once a second at most.


@contextmanager
def show_progress(stage: str, key: str) -> Generator[Progress, None, None]:
    """Shows Prefect how far a stage is, whoever tells it inside the block; yields a function that tells it.

    Args:
        stage: What a person calls it, such as ``Worlds``.
        key: Of the document's artifact, such as ``worlds-progress``: lower-case letters, digits and dashes.
    """
    bar, terminal = _Bar(stage, document_artifact_key(key)), current_listener()
    bar.show(0.0)

    def hear(at: str, done: int, total: int) -> None:
        terminal(at, done, total)
        if at == stage and bar.is_due():
            bar.show(100.0 * done / max(total, 1))

    with listen_to_progress(hear):
        yield stage_progress(stage)
    bar.show(100.0)


class _Bar:
    """A stage's bar on the server; while that is away the bar stands still, and the stage goes on."""

    def __init__(self, stage: str, key: str) -> None:
        self._stage, self._key = stage, key
        self._artifact: UUID | None = None
        self._shown_s = 0.0
        self._is_away = False
        self._settings: tuple[SettingsContext, SettingsContext] | None = None

    def is_due(self) -> bool:
        """Returns whether the bar was not moved for a while."""
        return time.monotonic() - self._shown_s >= (_INTERVAL_AWAY_S if self._is_away else _INTERVAL_S)

    def show(self, percent: float) -> None:
        """Moves the bar; an update that the server does not take is dropped, for the next one says more."""
        try:
            with self._without_retries():
                self._send(percent)
        except (TransportError, PrefectHTTPStatusError) as exc:
            if isinstance(exc, PrefectHTTPStatusError) and exc.response.status_code < 500:
                raise
            if not self._is_away:
                logger.warning(
                    "%s: progress is not told, the Prefect server does not answer (%s)", self._stage, type(exc).__name__
                )
            self._is_away = True
        else:
            self._is_away = False
        self._shown_s = time.monotonic()

    def _without_retries(self) -> SettingsContext:
        """Returns the settings as they are, without retries; made once, because they take as long as a few updates."""
        now = get_settings_context()
        if self._settings is None or self._settings[0] is not now:
            with temporary_settings({PREFECT_CLIENT_MAX_RETRIES: 0}):
                self._settings = now, get_settings_context()
        return self._settings[1]

    def _send(self, percent: float) -> None:
        if self._artifact is None:
            self._artifact = cast(
                "UUID", create_progress_artifact(progress=percent, key=self._key, description=self._stage)
            )
        else:
            update_progress_artifact(self._artifact, progress=percent)
