"""A deployment goes on beside what shows the verdict, which is decided and written before.

What fails in showing it is told, and decides nothing.
"""

from collections.abc import Callable

import pytest

from flows.pipeline import pipeline
from flows.pipeline.pipeline import Reports, _judge_and_deploy
from flows.pipeline.references import ParsedRun
from specs.data.run_report import StageReport
from specs.errors import StageFailed
from tasks.documents.pipeline_file import read_pipeline
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun
from tests.repository import ROOT

SIMULATED = StageReport(name="simulationBatch", arn="", status="Completed", summary="", seconds=0.0)
JUDGED = StageReport(name="gate", arn="", status="PASS", summary="", seconds=0.0)
DEPLOYED = StageReport(name="deployment", arn="", status="Succeeded", summary="", seconds=0.0)
Fails = Callable[[str, Exception], None]


@pytest.fixture
def fails(monkeypatch: pytest.MonkeyPatch) -> Fails:
    """Makes a step fail; without that all steps come to their ends."""

    def let_fail(name: str, failure: Exception) -> None:
        def fail(*_: object) -> None:
            raise failure

        monkeypatch.setattr(pipeline, name, fail)

    answers = {
        "authenticated_batch": lambda _work, batch: batch,
        "judge": lambda *_: (JUDGED,),
        "require_not_canceled": lambda *_: None,
        "deploy": lambda *_: (DEPLOYED,),
        "_show_trend": lambda stages, *_: stages,
        "_show_verdict": lambda stages, *_: stages,
    }
    for name, answer in answers.items():
        monkeypatch.setattr(pipeline, name, answer)
    return let_fail


def came_of(store: Store) -> tuple[Reports, Reports, Reports]:
    spec, record = read_pipeline(ROOT / "examples/quickstart.yaml"), begun(store).record()
    return _judge_and_deploy(ParsedRun(spec, ".", store, record), record, (SIMULATED,))


@pytest.mark.parametrize(("shows", "stage"), [("_show_verdict", 1), ("_show_trend", 0)])
def test_a_page_that_prefect_does_not_take_is_an_alarm_and_the_deployment_is_told_as_it_ended(
    file_store: Store, fails: Fails, shows: str, stage: int
):
    fails(shows, RuntimeError("the server\nsays 500"))
    found = came_of(file_store)
    assert found[2] == (DEPLOYED,)
    alarm = "What came of it could not be shown: RuntimeError: the server says 500"
    assert [[each.facts.get("alarm") for each in part] for part in found[:2]] == [
        [alarm if place == stage else None] for place in range(2)
    ]


def test_a_deployment_that_fails_is_told_though_the_verdict_could_not_be_shown(file_store: Store, fails: Fails):
    fails("_show_verdict", RuntimeError("the server says 500"))
    fails("deploy", StageFailed("DeploymentFailed", "a robot was lost"))
    with pytest.raises(StageFailed, match="a robot was lost"):
        came_of(file_store)
