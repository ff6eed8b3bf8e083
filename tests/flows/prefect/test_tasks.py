"""What Prefect's pages show of tasks: their names, how far they are, and what they left, in which no text is active."""

import logging
import re
from collections.abc import Callable
from uuid import UUID, uuid4

import httpx
import pytest
from prefect.exceptions import PrefectHTTPStatusError

from flows.batch.batch_steps import BatchTables
from flows.pipeline.run_gate import BatchJudgement
from flows.prefect import prefect_orchestrator, tasks
from flows.prefect.prefect_orchestrator import PrefectOrchestrator
from flows.prefect.tasks import chunk_name, show_progress
from specs.data.parity_audit import AuditReport
from specs.data.run_report import PipelineReport
from specs.errors import StoreAway
from specs.robomaker.deployment import DescribeDeploymentJobResponse, RobotDeployment
from tasks.deploy.fleet_descriptions import DeploymentView
from tasks.progress import listener
from tasks.progress.listener import listen_to_progress
from tasks.results.gate.gate_verdict import GateVerdict
from tasks.results.statistics.batch_summary import EpisodeCounts
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import submit
from tests.repository import ROOT
from tests.results.ci.full_reports import rule, stage

ACTIVE = "<img src=x onerror=alert(1)>|[click](javascript:alert(1))"
"""What a stranger may write into a name, a variable or the reason of a failure."""


def test_each_step_that_a_stage_runs_is_a_task():
    modules = [path.read_text() for path in (ROOT / "flows/pipeline").glob("*.py")]
    steps = {name for text in modules for name in re.findall(r"run_step(?:\(|, (?=\w+\)))(\w+)", text)}
    flows = {name for name in steps if f"{name} = " in (ROOT / "flows/prefect/flows.py").read_text()}
    assert {"draw_imported", "draw_worlds"} <= steps - flows
    assert [name for name in sorted(steps - flows - {"step"}) if not hasattr(tasks, name)] == []


def test_a_chunk_has_a_name_while_its_store_is_away(monkeypatch: pytest.MonkeyPatch):
    def away(_url: str) -> None:
        raise StoreAway("no answer")

    monkeypatch.setattr(tasks, "open_store", away)
    assert chunk_name({"number": 2, "store_url": "s3://b/p", "batch": "simb-1"}) == "chunk 3"


class Server:
    """Takes progress, or answers with an error."""

    def __init__(self) -> None:
        self.made: list[float] = []
        self.updates: list[float] = []
        self.error: Exception | None = None

    def create(self, progress: float, key: str, description: str) -> UUID:  # noqa: ARG002 - as Prefect's
        self._fail()
        self.made.append(progress)
        return uuid4()

    def update(self, artifact: UUID, progress: float) -> None:  # noqa: ARG002 - same
        self._fail()
        self.updates.append(progress)

    def _fail(self) -> None:
        if self.error:
            raise self.error


def refusal(status: int) -> PrefectHTTPStatusError:
    request = httpx.Request("POST", "http://127.0.0.1:1/api/artifacts/")
    return PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    found = Server()
    monkeypatch.setattr(tasks, "create_progress_artifact", found.create)
    monkeypatch.setattr(tasks, "update_progress_artifact", found.update)
    monkeypatch.setattr(listener, "_INTERVAL_S", 0.0)
    monkeypatch.setattr(tasks, "_INTERVAL_S", 0.0)
    monkeypatch.setattr(tasks, "_INTERVAL_AWAY_S", 0.0)
    return found


def test_a_bar_begins_moves_and_ends(server: Server) -> None:
    with show_progress("Episodes", "episodes-progress") as progress:
        progress(1, 4)
    assert (server.made, server.updates) == ([0.0], [25.0, 100.0])


@pytest.mark.parametrize("error", [httpx.ConnectError("refused"), httpx.ReadTimeout("silent"), refusal(503)])
def test_a_server_that_is_away_is_told_once_and_the_bar_goes_on_when_it_is_back(
    error: Exception, server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING), show_progress("Episodes", "episodes-progress") as progress:
        server.error = error
        progress(1, 4)
        progress(2, 4)
        server.error = None
        progress(3, 4)
    assert server.updates == [75.0, 100.0]
    assert [record.message for record in caplog.records] == [
        f"Episodes: progress is not told, the Prefect server does not answer ({type(error).__name__})"
    ]


def test_a_bar_is_made_when_the_server_comes_back(server: Server) -> None:
    server.error = httpx.ConnectError("refused")
    with show_progress("Episodes", "episodes-progress") as progress:
        server.error = None
        progress(1, 2)
    assert (server.made, server.updates) == ([50.0], [100.0])


@pytest.mark.parametrize("error", [refusal(422), ValueError("a defect")])
def test_what_is_no_outage_is_raised(error: Exception, server: Server) -> None:
    def work(progress: Callable[[int, int], None]) -> None:
        server.error = error
        progress(1, 4)

    with pytest.raises(type(error)), show_progress("Episodes", "episodes-progress") as progress:
        work(progress)


def test_bars_move_once_a_second_at_most_and_at_the_end(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listener, "_INTERVAL_S", 1.0)
    monkeypatch.setattr(tasks, "_INTERVAL_S", 1.0)
    now_s = [0.0]
    monkeypatch.setattr(tasks.time, "monotonic", lambda: now_s[0])
    in_terminal: list[int] = []
    with (
        listen_to_progress(lambda _stage, done, _total: in_terminal.append(done)),
        show_progress("Worlds", "worlds") as progress,
    ):
        for done in range(40):
            now_s[0] = 0.25 * done
            progress(done, 39)
    assert server.updates == pytest.approx([100.0 * done / 39 for done in range(4, 40, 4)] + [100.0])
    assert in_terminal == [*range(0, 40, 4), 39]


def test_text_of_strangers_is_neither_link_nor_html_in_what_is_left_on_pages(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    left: list[str] = []
    for module in (tasks, prefect_orchestrator):
        monkeypatch.setattr(module, "create_table_artifact", lambda table, **_: left.append(str(table[0])))
    monkeypatch.setattr(tasks, "create_markdown_artifact", lambda page, **_: left.append(page))
    robot = RobotDeployment(status="Failed", failureReason=ACTIVE)
    job = DescribeDeploymentJobResponse(status="Failed", robotDeploymentSummary=(robot,))
    record = submit(file_store, "deployment-job", {}, "token")
    monkeypatch.setattr(tasks, "view_deployment", lambda *_: DeploymentView(job, record, ACTIVE, ACTIVE, {}))
    audit = AuditReport(verdict="SUSPECT", sentence=ACTIVE).model_dump(mode="json")
    verdict = GateVerdict(
        verdict="FAIL",
        sentence=ACTIVE,
        counts=EpisodeCounts(episodes=0, successes=0, failed_jobs=0, canceled=0),
        rules=(rule("FAIL", ACTIVE, ACTIVE),),
    )
    deployed = {"store_url": file_store.url}, record
    for shown, parameters, result in (
        ("_show_tables", {"batch": "simb-1"}, BatchTables({}, [(ACTIVE,) * 5], "Wilson's")),
        ("_show_audit", {}, {"audit": audit, "audit_url": "file:///audit.json"}),
        ("_show_verdict", {}, BatchJudgement(verdict, "file:///evidence.json", "")),
        ("_show_robots", *deployed),
    ):
        getattr(tasks, shown)(parameters, result)
    PrefectOrchestrator().show_run_report(PipelineReport(run="run-1", name="n", stages=(stage(summary=ACTIVE),)))

    assert len(left) == 5
    assert all("onerror" in each for each in left)
    # Of each `<` and `[`, what makes it text stands in front of it: a backslash.
    assert [re.findall(r"(?<!\\)(?:<img|\[click\])", each) for each in left] == [[]] * 5
