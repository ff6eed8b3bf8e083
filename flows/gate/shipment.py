"""Lets a bundle be shipped if the gate passed it and everything that the gate saw is unchanged."""

from pydantic import JsonValue

from flows.document.tested_batch import tested_bundles
from flows.gate.judge import read_baseline, read_gate_answer
from specs.data.run_report import StageReport
from specs.errors import ResourceNotFound
from tasks.deploy.rollout.operator_commands import steer
from tasks.results.gate.evidence_check import evidence_faults
from tasks.results.gate.shipped_builds import Shipment
from tasks.simulate.batch.job import KIND, plan_of
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, job_id, read

_JOB = "deployment-job"


def shippable(batch: JobRecord, store: Store, run: JobRecord) -> dict[str, str]:
    """Returns the digest of each robot application that a batch tested, by name, but for what it was compared with."""
    other = read_baseline(store, run)
    return tested_bundles(plan_of(batch), other.digest if other else "")


def evidence_changes(
    shipped: str, store: Store, run: JobRecord, *, gated: bool = True, ships: Shipment | None = None
) -> list[str]:
    """Returns what is not as the gate of a run saw it, one line each; nothing if all is, or if there is no gate.

    Args:
        shipped: SHA-256 of the bundle that is to be shipped.
        store: Where everything is.
        run: The pipeline's run, with its gate's answer.
        ships: What is to be shipped, build by build.
        gated: Whether the document has a gate, without whose answer nothing is shipped.
    """
    answer = read_gate_answer(store, run)
    if answer is None:
        missing = f"{store.url}/{job_key(run.kind, run.id)} says no gate's answer, and the document has a gate"
        return [missing] if gated else []
    return evidence_faults(
        store,
        answer.batch,
        answer.evidence,
        shipped,
        lambda batch: recorded_location(read(store, KIND, batch)),
        ships=ships,
    )


def refusal_report(found: list[str], seconds: float) -> StageReport:
    """Returns the report of a deployment that was refused, naming all that has changed."""
    why = "; ".join(found)
    summary = f"nothing was deployed, since the evidence does not hold: {why}"
    facts: dict[str, JsonValue] = {"alarm": f"The deployment was refused: {why}"}
    return StageReport(name="deployment", arn="", status="Refused", summary=summary, seconds=seconds, facts=facts)


def withdraw_deployment(store: Store, token: str) -> None:
    """Cancels the deployment that the run began before it was killed, so that no further robot is asked."""
    try:
        record = read(store, _JOB, job_id(_JOB, token))
    except ResourceNotFound:
        return
    if not is_terminal(record):
        steer(store, record.id, "cancel")
