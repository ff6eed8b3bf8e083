"""Every step is a task of Prefect's, takes data alone, and can run in another process."""

import multiprocessing
from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import cloudpickle
import pytest
from prefect import Task
from prefect.exceptions import MissingResult

from flows.pipeline.orchestrator import Orchestrator, orchestrated_by
from flows.pipeline.pipeline import pipeline
from flows.prefect import tasks
from flows.prefect.prefect_orchestrator import PrefectOrchestrator
from flows.prefect.tasks import is_store_away
from specs.pipeline.document import PipelineSpec
from tests.factories.ros_maps import write_map
from tests.integration.runs import small_document, write_document

P = ParamSpec("P")
R = TypeVar("R")
TASKS: dict[str, Task[..., Any]] = {name: each for name, each in vars(tasks).items() if isinstance(each, Task)}


class OtherProcess(Orchestrator):
    """Runs each step in another process, which gets nothing but what can be pickled."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self.steps: set[str] = set()
        self._pool = pool

    def as_run(self, step: Callable[P, R]) -> Callable[P, R]:
        if step.__name__ not in TASKS:  # a stage, which runs steps itself
            return step
        self.steps.add(step.__name__)

        def run(*args: P.args, **kwargs: P.kwargs) -> R:
            return cloudpickle.loads(self._pool.submit(_run, cloudpickle.dumps((step, args, kwargs))).result())

        return run


def _run(call: bytes) -> bytes:
    step, args, kwargs = cloudpickle.loads(call)
    return cloudpickle.dumps(step(*args, **kwargs))


@pytest.fixture
def elsewhere() -> Generator[OtherProcess, None, None]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        yield OtherProcess(pool)


@pytest.mark.integration
@pytest.mark.long
def test_all_steps_of_a_document_run_in_another_process(elsewhere: OtherProcess, tmp_path: Path):
    write_map(tmp_path, ("#" * 100, *("#" + "." * 98 + "#",) * 98, "#" * 100))
    search = {"over": {"MAX_SPEED": {"uniform": [0.4, 0.6]}}, "budget": {"episodes": 1_000}}
    document = {**small_document(search=search), "worlds": [{"name": "hall", "source": "map.yaml"}]}
    write_document(tmp_path, document)
    with orchestrated_by(elsewhere):
        report = pipeline(PipelineSpec.model_validate(document), (tmp_path / "store").as_uri(), str(tmp_path))
    assert (report.passed, report.shipped) == (True, True)
    # Roll-outs of the API alone have these two; a document has its section's.
    assert elsewhere.steps == set(TASKS) - {"deploy_version", "sync_fleet"}


@pytest.mark.parametrize("name", TASKS)
def test_each_task_is_named_like_its_step_and_runs_again_when_the_store_was_away(name: str):
    task = TASKS[name]
    assert task.fn.__name__ == name
    assert task.retry_condition_fn is is_store_away
    assert task.persist_result is False


class LostFlow:
    """A flow whose last answer was lost."""

    def __init__(self, stage: Callable[..., object]) -> None:
        self.fn = stage

    def __call__(self, *_: object) -> str:
        raise MissingResult("State data is missing.")


def test_a_stage_whose_last_answer_was_lost_is_asked_again_for_what_it_did():
    def stage(worlds: int) -> str:
        return f"{worlds} worlds, found by the token"

    stages: Any = [LostFlow(stage)]
    assert PrefectOrchestrator(stages).as_run(stage)(8) == "8 worlds, found by the token"
