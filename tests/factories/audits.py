"""Audits in this process: what a run asks other processes for, and compares."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from specs.data.parity_audit import AuditReport
from specs.data.world import World
from tasks.simulate.audit.audit_drive import drive_audit, drive_control
from tasks.simulate.audit.audit_report import audit_report
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.devices import device_kind
from tasks.simulate.engines.engine_table import REFERENCE


def audit(
    sample: Sequence[SampledEpisode],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    progress: Callable[[int], None] = lambda _: None,
) -> AuditReport:
    """Returns what driving a sample again shows, as ``audit_run.ask_audit`` does."""
    here = [each.request for each in sample if each.row.device == device_kind()]
    others = [each.request for each in sample if each.row.engine != REFERENCE]
    drives = drive_audit(here, others, worlds, bundles, lanes=lanes, engine=engine, progress=progress)
    progress(2 * len(sample))
    again = [each for each in others if each.index in drives.theirs]
    return audit_report(sample, drives, lambda: drive_control(again, worlds, bundles, lanes=lanes))
