"""Where the results of a batch come from: its machines, the versions of its packages, and the seal of its owner.

Its record names the machines, its tables name the versions: no result depends on a machine, so that no table names one.

By the seal its owner vouches for what its record says of tables, counts, audit and early end. Who reads the record
later, such as a gate, takes these facts from a sealed record and nothing else of its detail.
"""

import json
import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from pydantic import JsonValue
from pydantic_core import to_json

from specs.base import canonical_json
from tasks.simulate.batch.batch_record import GOING, KIND, OpenBatch
from tasks.simulate.devices import device_count, device_kind, prepare_devices
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.sandbox.confinement import confinement
from tasks.storage.jobs.authenticator import BatchAuthenticator, has_owner_key
from tasks.storage.jobs.records import JobRecord, advance

_PROCESSORS = Path("/proc/cpuinfo")
_NAME = "model name"
_MARK, _GL_MARK = "machine/", "gl/"
SEALED = ("sha256s", "counts", "metadata", "audit", "stopped_early")
_SEAL = "seal"
_WHAT = "end"
_PACKAGES = ("simyard", "mujoco", "mujoco-mjx", "jax", "numpy")


def note_machine(batch: OpenBatch) -> None:
    """Adds this machine to a batch's record, once however often the batch is continued here."""
    name = this_machine()
    mark: dict[str, JsonValue] = {
        f"{_MARK}{name}": {
            "device": device_kind(),
            "name": _device_name(),
            "devices": device_count(),
            "system": f"{platform.system()} {platform.machine()}",
            "applications": f"run {confinement().sentence}",
        }
    }
    _note(batch, mark)


def note_gl(batch: OpenBatch, gl: str) -> None:
    """Adds a GL to a batch's record that drew what colour cameras saw: another may round their pixels otherwise."""
    _note(batch, {f"{_GL_MARK}{gl}": this_machine()})


def _note(batch: OpenBatch, mark: Mapping[str, JsonValue]) -> None:
    record = batch.record()
    if record.status in GOING and not mark.keys() <= record.detail.keys():
        # Only as it was read: whoever stops the batch meanwhile is not overruled.
        advance(batch.store, KIND, batch.id, record.status, only_from={record.status}, detail=dict(mark))


def this_machine() -> str:
    """Returns what `note_machine` calls this machine: its processor or GPU, and its system."""
    return f"{_device_name()}, {platform.system()} {platform.machine()}"


def recorded_machines(record: JobRecord) -> list[str]:
    """Returns the machines that worked on a batch, as its record has them."""
    return [key.removeprefix(_MARK) for key in record.detail if key.startswith(_MARK)]


def recorded_gls(record: JobRecord) -> list[str]:
    """Returns which GLs drew what colour cameras saw, as a batch's record has them; none in older ones."""
    return [key.removeprefix(_GL_MARK) for key in record.detail if key.startswith(_GL_MARK)]


def another_gl(record: JobRecord, gl: str) -> str:
    """Returns what to tell a person if pictures of a batch are drawn anew by a GL that drew none of it; else nothing.

    Args:
        record: The batch's.
        gl: Which draws now; empty if none does.
    """
    before = recorded_gls(record)
    if not before or not gl or gl in before:
        return ""
    return f"its pictures were drawn by {' and '.join(before)}, and now are by {gl}"


def _device_name() -> str:
    if device_kind() == "gpu":
        prepare_devices()
        import jax  # noqa: PLC0415 - it reads its settings when it is imported

        return str(jax.devices()[0].device_kind)
    return _processor()


def _processor() -> str:
    try:
        lines = _PROCESSORS.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith(_NAME))
    return next(names, "") or platform.processor() or os.name


def batch_metadata(lanes: int) -> dict[str, str]:
    """Returns the lanes of a chunk under ``lanes``, and the versions of the packages that decide results, by package.

    Which engines and kinds of device ran stands in each row. The machine's name and cores decide no result, so that
    they are in the batch's record alone, and the tables are the same bytes elsewhere.
    """
    return {"lanes": str(lanes), **{package: version(package) for package in _PACKAGES}}


def seal(batch: OpenBatch, detail: Mapping[str, JsonValue]) -> dict[str, JsonValue]:
    """Returns what a batch's record says besides: what vouches for its facts.

    Args:
        batch: A batch whose tables were written from chunks that its owner vouches for.
        detail: What its record says of them.
    """
    return {_SEAL: batch.authenticator.mac(_WHAT, _body(detail))}


def is_sealed(record: JobRecord, authenticator: BatchAuthenticator) -> bool:
    """Returns whether the owner vouches for a record's facts, and for its plan, which the authenticator is made of."""
    mac = record.detail.get(_SEAL)
    return (
        record.status == "Completed"
        and isinstance(mac, str)
        and authenticator.authenticates(mac, _WHAT, _body(record.detail))
    )


def unvouched_notice(batch: OpenBatch) -> str:
    """Returns what to tell a person who is shown results that nobody here vouches for; empty for others."""
    record = batch.record()
    if record.status != "Completed" or (has_owner_key() and is_sealed(record, batch.authenticator)):
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
