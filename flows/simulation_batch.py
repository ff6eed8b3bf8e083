"""The flow `simulation-batch`: drives a robot application through worlds, seeds and parameters."""

from prefect import flow

from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.parameter.document_parameter import SimulationBatchParameter
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.prefect_orchestrator import flow_result, run_name, under_prefect
from flows.run.cancellation import cancel_with_flow_run
from flows.stage import batch_stage
from specs.pipeline.gate_section import Gate
from tasks.storage.jobs.records import JobRecord


@guarded
@flow(
    name="simulation-batch",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def simulation_batch(
    spec: SimulationBatchParameter,
    worlds: list[str] | None = None,
    store: StoreParameter = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    gate: Gate | None = None,
) -> JobRecord:
    """Returns the batch, whose ``detail`` says where results and failures lie and what they add up to.

    Args:
        spec: The pipeline's section ``simulationBatch``, or ``{document: path}``.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.
        gate: Given by the pipeline if its gate may end the batch early.

    Raises:
        DocumentError: A request cannot be run, or names what does not exist.
        StageFailed: The batch timed out, was cancelled, or failed for a reason of Simyard's own.
    """
    with under_prefect():
        return completed_job(
            flow_result(
                lambda: batch_stage.simulation_batch(spec, worlds, store_at(store), versions, token, gate=gate), token
            )
        )
