"""Batches to report on without a simulator or a store: tables written as a batch writes them, and what records say."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.parity_audit import AuditReport
from specs.data.world import World
from tasks.results.report.batch_facts import BatchFacts, Judgement, Link, StageTime
from tasks.results.report.report_columns import DrivenWorlds
from tasks.results.report.report_view import ReportView, report_view
from tasks.results.tables.episode_tables import failures_table, results_table
from tasks.results.tables.parquet import write_parquet
from tests.factories.episodes import ROBOT, SCENARIO, canceled, collided, crashed, passed, request
from tests.factories.worlds import apartment

WORLDS = ("wgj-1/world-1-1", "wgj-1/world-2-1")
KINDS = (passed, collided, passed, crashed, passed, canceled)


def facts(**changes: object) -> BatchFacts:
    """Returns what records say of a judged batch of two worlds and two speeds."""
    base = BatchFacts(
        batch="simb-1",
        arn="arn:simyard:simulation-job-batch:0123456789ab:simb-1",
        store="0123456789ab",
        name="nightly",
        status="Completed",
        why="",
        created_at_s=1_700_000_000.0,
        simulated_s=7_260.0,
        seeds=3,
        worlds=dict.fromkeys(WORLDS, "c" * 64),
        variables={"MAX_SPEED": ("0.3", "0.6"), "GOALS": ("2",)},
        robots=(ROBOT,),
        simulations=(SCENARIO,),
        metadata={"engine": "planar", "device": "cpu", "lanes": "16", "simyard": "0.1.0"},
        judgement=Judgement(verdict="FAIL", sentence="FAIL: too few passed", at_least=0.9, confidence=0.95),
        audit=AuditReport(verdict="SOUND", sentence="16 lanes on C MuJoCo", engine="planar"),
        stages=(StageTime(name="simulationBatch", seconds=15.2, summary="383 of 384"),),
        links=(Link(label="results.parquet", href="results.parquet", sha256="f" * 64),),
    )
    return base.model_copy(update=changes)


def episodes(
    count: int = 12, worlds: Sequence[str] = WORLDS
) -> tuple[tuple[EpisodeRequest, ...], tuple[EpisodeResult, ...]]:
    """Returns episodes of every kind in turn, in all worlds and at both speeds in turn."""
    requests = tuple(
        request(
            index, world=worlds[index % len(worlds)], seed=index, environment={"MAX_SPEED": ("0.3", "0.6")[index % 2]}
        )
        for index in range(count)
    )
    return requests, tuple(KINDS[index % len(KINDS)](index) for index in range(count))


def written(folder: Path, requests: Sequence[EpisodeRequest], results: Sequence[EpisodeResult]) -> tuple[Path, Path]:
    """Returns the files of both tables."""
    files = folder / "results.parquet", folder / "failures.parquet"
    for table, file in zip((results_table, failures_table), files, strict=True):
        write_parquet(table("simb-1", requests, results, ["MAX_SPEED"]), file)
    return files


def view(
    folder: Path,
    requests: Sequence[EpisodeRequest] | None = None,
    results: Sequence[EpisodeResult] | None = None,
    *,
    worlds: Mapping[str, World] | None = None,
    **changes: object,
) -> ReportView:
    """Returns what the report of a batch shows; all is as in `facts` and `episodes` but for what is given."""
    asked, answered = episodes()
    files = written(folder, asked if requests is None else requests, answered if results is None else results)
    found = {name: apartment(name=name.partition("/")[2]) for name in WORLDS} if worlds is None else worlds
    named = {"worlds": dict.fromkeys(found or WORLDS, "c" * 64)}
    return report_view(facts(**{**named, **changes}), *files, as_read(found))


def as_read(worlds: Mapping[str, World]) -> DrivenWorlds:
    """Returns worlds as a report reads them."""
    starts_m = {name: (each.start.x_m, each.start.y_m) for name, each in worlds.items() if each.start}
    return DrivenWorlds({name: world.areas for name, world in worlds.items()}, lambda name: worlds[name], starts_m)
