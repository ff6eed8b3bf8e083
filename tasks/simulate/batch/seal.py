"""The seal of a batch: its owner vouches for what its record says of tables, counts, audit and early end.

Who reads the record later, such as a gate, takes these facts from a sealed record and nothing else of its detail.
"""

import json
from collections.abc import Mapping

from pydantic import JsonValue
from pydantic_core import to_json

from specs.digest import canonical_json
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.voucher import Voucher, has_owner_key

SEALED = ("sha256s", "counts", "metadata", "audit", "stopped_early")
_SEAL = "seal"
_WHAT = "end"


def seal(batch: OpenBatch, detail: Mapping[str, JsonValue]) -> dict[str, JsonValue]:
    """Returns what a batch's record says besides: what vouches for its facts.

    Args:
        batch: A batch whose tables were written from chunks that its owner vouches for.
        detail: What its record says of them.
    """
    return {_SEAL: batch.voucher.mac(_WHAT, _body(detail))}


def is_sealed(record: JobRecord, voucher: Voucher) -> bool:
    """Returns whether the owner vouches for a record's facts, and for its plan, which the voucher is made of."""
    mac = record.detail.get(_SEAL)
    return record.status == "Completed" and isinstance(mac, str) and voucher.vouches(mac, _WHAT, _body(record.detail))


def unvouched_notice(batch: OpenBatch) -> str:
    """Returns what to tell a person who is shown results that nobody here vouches for; empty for others."""
    record = batch.record()
    if record.status != "Completed" or (has_owner_key() and is_sealed(record, batch.voucher)):
        return ""
    why = "another machine or an older version wrote them, or somebody changed them"
    return f"{batch.id}: this machine's key does not vouch for these results: {why}"


def with_facts(record: JobRecord, plan: BatchPlan, facts: Mapping[str, JsonValue]) -> JobRecord:
    """Returns a record that says this plan, and of the facts that are sealed these."""
    others = {name: value for name, value in record.detail.items() if name not in SEALED}
    request = {**record.request, "plan": plan.model_dump(mode="json")}
    return record.model_copy(update={"request": request, "detail": {**others, **facts}})


def facts_of(detail: Mapping[str, JsonValue]) -> dict[str, JsonValue]:
    """Returns those of a record's facts that are sealed; one that it does not have is left out."""
    return {name: detail[name] for name in SEALED if detail.get(name) is not None}


def _body(detail: Mapping[str, JsonValue]) -> bytes:
    return canonical_json(json.loads(to_json(facts_of(detail), inf_nan_mode="null")))
