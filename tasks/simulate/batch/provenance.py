"""The machines that a batch ran on, in its record, and the package versions that its numbers depend on, in its tables.

No result depends on a machine, so that no table names one.
"""

import os
import platform
from importlib.metadata import version
from pathlib import Path

from pydantic import JsonValue

from tasks.simulate.batch.job import GOING, KIND, OpenBatch
from tasks.simulate.devices import device_count, device_kind, prepare_devices
from tasks.simulate.process.confinement import confinement
from tasks.storage.jobs.records import JobRecord, advance

_PROCESSORS = Path("/proc/cpuinfo")
_NAME = "model name"
_MARK = "machine/"
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
    record = batch.record()
    if record.status in GOING and not mark.keys() <= record.detail.keys():
        # Only as it was read: whoever stops the batch meanwhile is not overruled.
        advance(batch.store, KIND, batch.id, record.status, only_from={record.status}, detail=mark)


def this_machine() -> str:
    """Returns what `note_machine` calls this machine: its processor or GPU, and its system."""
    return f"{_device_name()}, {platform.system()} {platform.machine()}"


def recorded_machines(record: JobRecord) -> list[str]:
    """Returns the machines that worked on a batch, as its record has them."""
    return [key.removeprefix(_MARK) for key in record.detail if key.startswith(_MARK)]


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
    they are in the batch's record alone (``tasks.simulate.batch.provenance``), and the tables are the same bytes
    elsewhere.
    """
    return {"lanes": str(lanes), **{package: version(package) for package in _PACKAGES}}
