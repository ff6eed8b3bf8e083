"""All that can go wrong in one batch goes wrong at once: each is a row, and the others are the same bits without it."""

from collections.abc import Sequence

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.plan.batch_plan import JobTemplate
from tasks.simulate.plan.chunks import plan_chunks
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun, plan, put_world
from tests.factories.simulations import ENDLESS, FOLDERS, PLAIN, PUSHER, pushing, simulate_lanes
from tests.simulate.conftest import PUSHER_LANES

pytestmark = pytest.mark.long

SOUND, NOT_FINITE, TOO_STRONG, EXPLODING = "0", "1", "2", "3"
# The faults of lanes 1, 3 and 5; 0, 2, 4 and 7 are sound, and 6 has a world of its own.
FAULTS = {1: NOT_FINITE, 3: TOO_STRONG, 5: EXPLODING}
WHY = {
    1: ("RobotApplicationCrash", "controller.step: returned a control that is not finite"),
    3: ("SimulationApplicationCrash", "not finite, or beyond 1e10"),
    5: ("SimulationApplicationCrash", "not finite, or beyond 1e10"),
}
PLAIN_ROBOT = ApplicationLaunch(name="plain", version="1", digest=PLAIN, package="plain", launch_file="counting")


def _requests(faults: dict[int, str], odd_world: str) -> list[EpisodeRequest]:
    worlds = [f"hand/pen-{k % 3}" if k != 6 else odd_world for k in range(PUSHER_LANES)]
    return [
        pushing(k, world=world, seed=k, fault=faults.get(k, SOUND), duration_s=2.0) for k, world in enumerate(worlds)
    ]


def _run(requests: Sequence[EpisodeRequest], worlds: dict[str, World], engine: str) -> dict[int, EpisodeResult]:
    (chunk,) = plan_chunks(requests, PUSHER_LANES)
    rows = simulate_lanes(chunk, worlds, FOLDERS, lanes=PUSHER_LANES, engine=engine, should_stop=lambda: False)
    return {row.index: row for row in rows}


@pytest.mark.parametrize("engine", ["planar", pytest.param("mjx", marks=pytest.mark.soak), "mujoco"])
def test_lanes_that_fail_each_in_its_own_way_leave_the_others_alone(pens: dict[str, World], engine: str):
    cursed = {**pens, "hand/cursed": pens["hand/pen-0"].model_copy(update={"name": "cursed"})}
    sound = _run(_requests({}, "hand/pen-0"), cursed, engine)
    assert {row.status for row in sound.values()} == {"Completed"}
    for odd_world, odd in (
        ("hand/lost", ("InvalidS3Resource", "world hand/lost does not exist")),
        ("hand/cursed", ("SimulationApplicationCrash", "scenario.place: ValueError: nobody starts here")),
    ):
        rows = _run(_requests(FAULTS, odd_world), cursed, engine)
        for index, (code, reason) in {**WHY, 6: odd}.items():
            row = rows.pop(index)
            assert (row.index, row.status, row.failure_code, row.outcome_reason) == (index, "Failed", code, "crash")
            assert reason in row.failure_reason
        assert rows == {index: sound[index] for index in (0, 2, 4, 7)}


def _entry(robot: ApplicationLaunch = PUSHER, fault: str = SOUND, **changes: object) -> JobTemplate:
    base = JobTemplate(
        robot=robot, scenario=ENDLESS, environment={"FAULT": fault}, duration_s=2.0, failure_behavior="Fail"
    )
    return base.model_copy(update=changes)


def _launching(launch_file: str) -> JobTemplate:
    return _entry(PUSHER.model_copy(update={"launch_file": launch_file}))


RAISING_AT_STEP = "3"
# Each entry of a batch, and what is to become of it.
ENTRIES: list[tuple[JobTemplate, str, str]] = [
    (_entry(), "", ""),
    (_launching("raising"), "RobotApplicationCrash", "controller.step: RuntimeError: no idea where to go"),
    (_launching("unimportable"), "RobotApplicationCrash", "faulty: importing faulty/unimportable.py"),
    (_launching("absent"), "RobotApplicationCrash", "faulty: importing faulty/absent.py: ModuleNotFoundError"),
    (_launching("growing"), "RobotApplicationCrash", "controller.step: returns a state of another form"),
    (_entry(worlds=("g/lost",)), "InvalidS3Resource", "world g/lost does not exist"),
    (_entry(fault=NOT_FINITE), "RobotApplicationCrash", "not finite"),
    (_entry(PLAIN_ROBOT), "", ""),
    (_entry(PLAIN_ROBOT, RAISING_AT_STEP), "RobotApplicationCrash", "controller.step: RuntimeError: tired of this"),
    (_entry(fault=EXPLODING), "SimulationApplicationCrash", "beyond 1e10"),
    (_entry(), "", ""),
]


def _batch(store: Store, templates: Sequence[JobTemplate], name: str) -> OpenBatch:
    digests = {reference: put_world(store, reference) for reference in ("g/w0", "g/lost")}
    store.delete(world_key("g", "lost"))
    made = plan(
        store, templates=tuple(templates), worlds=("g/w0",), seeds=(0, 1), lanes=PUSHER_LANES, world_digests=digests
    )
    return begun(store, made, name)


def _simulated(batch: OpenBatch) -> list[EpisodeResult]:
    """Returns all rows; the first attempt at each chunk lacks memory."""

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        if part.lanes > PUSHER_LANES:
            raise MemoryError(f"no room for {part.lanes} lanes")
        return simulate_lanes(part.chunk, part.worlds, FOLDERS, lanes=part.lanes, should_stop=part.watch)

    rows: list[EpisodeResult] = []
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, simulate, lanes=2 * PUSHER_LANES, left_s=3600.0)
        rows += committed_chunk(batch.store, batch.id, number) or ()
    return sorted(rows, key=lambda row: row.index)


def test_a_batch_full_of_failures_has_a_row_with_code_and_reason_for_each_and_sound_ones_as_if_they_were_alone(
    file_store: Store,
):
    rows = _simulated(_batch(file_store, [entry for entry, _, _ in ENTRIES], "all"))
    sound = _simulated(_batch(file_store, [entry for entry, code, _ in ENTRIES if not code], "sound"))
    kept: list[EpisodeResult] = []
    for index, row in enumerate(rows):
        _, code, reason = ENTRIES[index // 2]
        assert (row.index, row.failure_code, row.status) == (index, code, "Failed" if code else "Completed")
        assert reason in row.failure_reason
        kept += [] if code else [row]
    assert kept == [row.model_copy(update={"index": kept[at].index}) for at, row in enumerate(sound)]
