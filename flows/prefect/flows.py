"""Simyard's flows as Prefect has them: the pipeline, each of its stages alone, and reaping.

`flows.pipeline.pipeline` composes the stages; here each becomes a flow, with its parameters and their help. A stage
inside a pipeline's flow is a flow run of its own.
"""

import functools
import inspect
import logging
from collections.abc import Callable, Sequence
from typing import Any, ParamSpec, TypeVar

from prefect import Flow, flow
from prefect.artifacts import create_table_artifact

from flows.pipeline import pipeline as stages
from flows.prefect.flow_calls import (
    completed_job,
    completed_reaping,
    completed_run,
    result_serializer,
    tell_failures_once,
)
from flows.prefect.flow_runs import cancel_with_flow_run, end_abandoned_flow_runs
from flows.prefect.parameters import (
    DeploymentParameter,
    DocumentParameter,
    SimulationBatchParameter,
    StoreParameter,
    WorldExportParameter,
    WorldGenerationParameter,
    guarded,
    store_at,
)
from flows.prefect.prefect_events import announce_changes
from flows.prefect.prefect_orchestrator import flow_result, run_name, under_prefect
from flows.resources.abandoned_jobs import ReapedJob, reap_jobs
from flows.resources.fleet_membership import renew_metadata_here
from specs.untrusted_text import table_rows
from tasks.storage.store_url import open_store

P = ParamSpec("P")
R = TypeVar("R")
_LOG = logging.getLogger(__name__)


def as_flow(
    stage: Callable[P, R],
    spec: object,
    *,
    completed: Callable[[Any], Any] = completed_job,
    flow_run_name: Callable[[], str] | str = run_name,
    stages: Sequence[Flow[..., Any]] = (),
) -> Flow[P, R]:
    """Returns a stage as a flow, which has the stage's name, parameters and help.

    Its parameter ``spec`` may name a document's file, and ``store`` a block of Prefect's.

    Args:
        stage: A plain function, whose steps the orchestrator runs.
        spec: Type of its first parameter, as Prefect's forms have it.
        completed: Makes the state of the flow run of what the stage returned.
        flow_run_name: What Prefect's pages call a run.
        stages: The flows of the stages that it runs itself.
    """
    shape = inspect.signature(stage)

    @functools.wraps(stage, assigned=("__name__", "__qualname__", "__doc__"))
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        given = shape.bind(*args, **kwargs)
        given.arguments["store"] = store_at(given.arguments.get("store"))
        tell_failures_once()
        with under_prefect(stages):
            token = given.arguments.get("token")
            return completed(flow_result(lambda: stage(*given.args, **given.kwargs), token))

    types = {"spec": spec, "store": StoreParameter}
    shown = [each.replace(annotation=types.get(name, each.annotation)) for name, each in shape.parameters.items()]
    run.__signature__ = shape.replace(parameters=shown)  # pyright: ignore[reportAttributeAccessIssue] - inspect reads it
    run.__annotations__ = {**{each.name: each.annotation for each in shown}, "return": shape.return_annotation}
    return guarded(
        flow(
            name=stage.__name__.replace("_", "-"),
            flow_run_name=flow_run_name,
            persist_result=True,
            result_serializer=result_serializer(),
            on_cancellation=[cancel_with_flow_run],
        )(run)
    )


world_generation = as_flow(stages.world_generation, WorldGenerationParameter)
world_export = as_flow(stages.world_export, WorldExportParameter)
simulation_batch = as_flow(stages.simulation_batch, SimulationBatchParameter)
deployment_sync = as_flow(stages.deployment_sync, DeploymentParameter)
pipeline = as_flow(
    stages.pipeline,
    DocumentParameter,
    completed=completed_run,
    flow_run_name="{spec.name}",
    # Without results of their own: where somebody has an ended flow run retried, Prefect would take each stage that has
    # one for done, and the document's next run would have the jobs of the one before.
    stages=[
        each.with_options(persist_result=False)
        for each in (world_generation, world_export, simulation_batch, deployment_sync)
    ],
)


@guarded
@flow(name="reaping", persist_result=True, result_serializer=result_serializer())
def reaping(store: StoreParameter = None) -> list[ReapedJob]:
    """Returns the abandoned jobs that were found, and leaves a table of them; see `simyard reap`.

    The flow runs that worked on abandoned runs become Crashed. What the keys in SIMYARD_KEYS have signed is signed
    anew in the second half of its time.

    Args:
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.

    Raises:
        TrustRefused: The metadata in the store is not what the keys signed, or is older than it was.
    """
    opened = open_store(store_at(store))
    with announce_changes():
        found = reap_jobs(opened)
        for flow_run in end_abandoned_flow_runs(opened):
            _LOG.info(
                "flow run %s had no process any more and is Crashed, or Cancelled if somebody asked for it", flow_run
            )
        for line in renew_metadata_here(opened):
            _LOG.warning("%s: simyard fleet keys renew, with its key", line)
    if found:
        rows = table_rows(each.model_dump(mode="json") for each in found)
        create_table_artifact(rows, key="reaped", description=f"{len(found)} jobs that nobody worked on")
    return completed_reaping(found)
