"""What does not fit into memory is run in smaller parts, and what comes of it stays the same."""

import math
import os
import socket
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from specs.data.column_bytes import encode_columns
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult, Failure, failed_result
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.lane.recording import Columns, Recorder, RecordingChoice
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.sandbox import sandbox_client as lanes_module
from tasks.simulate.sandbox import simulator
from tasks.simulate.sandbox.confinement import confinement
from tasks.simulate.sandbox.protocol import Answer, RecordingBegins, RecordingEnds, Rows, Samples, SentWorlds
from tasks.simulate.sandbox.sandbox_client import SandboxClient, TooManyLanes, after_deaths, retry_with_fewer_lanes
from tasks.simulate.sandbox.simulator import SimulatorEnded, Told
from tests.factories.episodes import collided, passed
from tests.factories.simulations import BUNDLES, DRIFT, ENDLESS, FAULTY, FOLDERS, delivery, pushing, simulate_lanes

FITTED_CHUNK = Chunk(number=3, requests=tuple(delivery(100 + k, world="w") for k in range(40)))


class Memory:
    """A simulator that has room for so many lanes."""

    def __init__(self, room: int, lack: Exception) -> None:
        self.room, self.lack = room, lack
        self.tried: list[int] = []

    def simulate(self, chunk: Chunk, lanes: int) -> list[EpisodeResult]:
        self.tried.append(lanes)
        assert len(chunk.requests) <= lanes
        if lanes > self.room:
            raise self.lack
        return [passed(each.index) for each in chunk.requests]


def never() -> bool:
    return False


LACKS = [
    MemoryError("no room"),
    RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 800000000000 bytes."),
]


@pytest.mark.parametrize("lack", LACKS)
def test_half_as_many_lanes_are_tried_until_they_fit(lack: Exception):
    memory = Memory(20, lack)
    rows, lanes = retry_with_fewer_lanes(FITTED_CHUNK, 64, memory.simulate, never)
    assert [row.index for row in rows] == [request.index for request in FITTED_CHUNK.requests]
    assert (lanes, memory.tried) == (16, [64, 32, 16, 16, 16])


def test_as_many_lanes_are_tried_as_are_known_to_fit():
    memory = Memory(24, TooManyLanes("too many applications", 24))
    rows, lanes = retry_with_fewer_lanes(FITTED_CHUNK, 64, memory.simulate, never)
    assert [row.index for row in rows] == [request.index for request in FITTED_CHUNK.requests]
    assert (lanes, memory.tried) == (24, [64, 24, 24])


def test_numpys_own_lack_of_memory_is_one_too():
    with pytest.raises(MemoryError) as lack:
        np.zeros((1 << 60,), np.int8)
    assert retry_with_fewer_lanes(FITTED_CHUNK, 16, Memory(8, lack.value).simulate, never).lanes == 8


def test_what_does_not_fit_at_all_fails_by_our_fault():
    rows, lanes = retry_with_fewer_lanes(FITTED_CHUNK, 16, Memory(7, MemoryError("no room")).simulate, never)
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InternalServiceError")}
    assert rows.rows()[0].failure_reason == "out of memory even with 8 lanes: no room"
    assert (len(rows), lanes) == (40, 8)


def test_any_other_error_is_not_taken_for_a_lack_of_memory():
    with pytest.raises(RuntimeError, match="INTERNAL"):
        retry_with_fewer_lanes(FITTED_CHUNK, 64, Memory(0, RuntimeError("INTERNAL: broken")).simulate, never)


def test_what_was_simulated_before_memory_ran_out_is_kept():
    memory = Memory(64, MemoryError())
    calls: list[int] = []

    def shrinking(chunk: Chunk, lanes: int) -> list[EpisodeResult]:
        calls.extend(each.index for each in chunk.requests)
        memory.room = 16 if len(memory.tried) == 1 else memory.room
        return memory.simulate(chunk, lanes)

    rows, lanes = retry_with_fewer_lanes(FITTED_CHUNK, 32, shrinking, never)
    assert [row.index for row in rows] == [request.index for request in FITTED_CHUNK.requests]
    assert (lanes, memory.tried) == (16, [32, 32, 16])
    assert calls == [*range(100, 132), *range(132, 140), *range(132, 140)]


def test_parts_after_a_stop_are_canceled_and_not_begun():
    memory = Memory(16, MemoryError())
    rows, _ = retry_with_fewer_lanes(FITTED_CHUNK, 16, memory.simulate, lambda: True)
    assert memory.tried == [16]
    assert [row.status for row in rows] == [*["Completed"] * 16, *["Canceled"] * 24]


@pytest.mark.parametrize(
    ("lanes", "attempts", "begun_with"), [(256, 1, 256), (256, 2, 256), (256, 3, 128), (256, 9, 8), (4, 9, 4)]
)
def test_a_first_death_is_an_accident_and_further_ones_may_be_a_lack_of_memory(
    lanes: int, attempts: int, begun_with: int
):
    assert after_deaths(lanes, attempts) == begun_with


CHUNK: Chunk = plan_chunks([pushing(index, world="hand/pen-0") for index in range(3)], 8)[0]
Said = Sequence[tuple[Answer, tuple[np.ndarray, ...]]]


def told(*rows: EpisodeResult) -> np.ndarray:
    return np.frombuffer(encode_columns(EpisodeColumns.of(rows)), np.uint8)


class Process:
    """A process that answers as a test says, and is ended if that is no answer."""

    output = SimpleNamespace(take=str)

    def __init__(self, said: Said) -> None:
        self._said, self.ended, self.broke = said, 0, 0

    def sent_worlds(self, worlds: Mapping[str, World]) -> SentWorlds:
        return SentWorlds(new=dict.fromkeys(worlds, "{}"))

    def new_chunks(self, chunks: Sequence[Chunk]) -> tuple[Chunk, ...]:
        return tuple(chunks)

    def ask(self, work: object, *, on_answer: Callable[..., None], should_stop: object) -> Told:
        assert work is not should_stop
        *between, last = self._said
        for answer, arrays in between:
            on_answer(answer, arrays)
        return last

    def refused(self, answer: Exception) -> SimulatorEnded:
        self.ended += 1
        return SimulatorEnded(f"it answered what is no answer: {answer}", None, "", killed="limit")

    def broke_off(self, why: str) -> SimulatorEnded:
        self.broke += 1
        return SimulatorEnded(why, None, "", killed="limit")


@pytest.fixture
def simulate(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[list[EpisodeResult], Process]]:
    def rows(*said: tuple[Answer, tuple[np.ndarray, ...]], rate_hz: float = 0.0) -> tuple[list[EpisodeResult], Process]:
        process = Process(said)

        @contextmanager
        def one(_: object) -> Generator[Process]:
            yield process

        monkeypatch.setattr(lanes_module, "simulator", one)
        recorder = Recorder(rate_hz, lambda _: True) if rate_hz else None
        lanes = SandboxClient({}, 8, "auto", should_stop=lambda: False, rate_hz=rate_hz or 1.0, recorder=recorder)
        return lanes.simulate(CHUNK, {}).rows(), process

    return rows


Simulate = Callable[..., tuple[list[EpisodeResult], Process]]


@pytest.mark.parametrize(
    "arrays",
    [
        (),
        (np.zeros(9, np.uint8),),
        (np.zeros(0),),
        (told(passed(0))[:-1],),
        (np.concatenate([told(passed(0), passed(1), passed(2)), np.zeros(1, np.uint8)]),),
        (np.full((2, 2), np.nan),),
    ],
)
def test_what_are_no_rows_is_no_answer_and_ends_the_process(simulate: Simulate, arrays: tuple[np.ndarray, ...]):
    rows, process = simulate((Rows(), arrays))
    assert {row.status for row in rows} == {"Failed"}
    assert all(row.failure_reason.startswith("it answered what is no answer: ") for row in rows)
    assert process.ended >= 1


@pytest.mark.parametrize("others", [(0, 1), (0, 1, 2, 3), (0, 1, 4), (0, 0, 1)])
def test_rows_of_other_episodes_are_refused_and_end_the_process(simulate: Simulate, others: tuple[int, ...]):
    rows, process = simulate((Rows(), (told(*map(passed, others)),)))
    assert {row.failure_reason for row in rows} == {"it answered with rows of other episodes"}
    assert process.broke >= 1


BEGUN: tuple[Answer, tuple[np.ndarray, ...]] = (RecordingBegins(lanes=3, control_s=0.05), ())
NONE, PLACE = np.zeros(3, int), np.zeros((3, 3))
PEOPLE = np.zeros((3, 4, 2))
ENDS = (NONE, NONE == 1, PLACE, PLACE, PLACE, NONE, PLACE[:, None, :2], np.zeros((3, 7)), *[PEOPLE] * 6)
SEEN = (PLACE[:, None], PLACE[:, None], PLACE, PLACE)
STEP = (PLACE[:, None], PLACE[:, None], NONE[:, None], *SEEN, np.zeros((3, 1)), *[PEOPLE[:, None]] * 3)
ALL = told(*map(passed, range(3)))


@pytest.mark.parametrize(
    "said",
    [
        [(RecordingBegins(lanes=1 << 40, control_s=0.05), ())],
        [(RecordingBegins(lanes=-1, control_s=0.05), ())],
        [(RecordingBegins(lanes=3, control_s=math.nan), ())],
        [(Samples(steps=1), (*STEP, NONE))],
        [BEGUN, (Samples(steps=1), ())],
        [BEGUN, (Samples(steps=1), (*STEP[1:], NONE))],
        [BEGUN, (Samples(steps=1 << 40), (*STEP, NONE))],
        [BEGUN, (Samples(steps=1), (*(array[:2] for array in STEP), NONE))],
        [BEGUN, (Samples(steps=1), (*STEP, NONE[0]))],
        [
            BEGUN,
            (Samples(steps=1), (*STEP[:4], np.zeros((3, 1, 5_000)), *STEP[5:6], np.zeros((3, 5_000)), *STEP[7:], NONE)),
        ],
        [BEGUN, (Samples(steps=1), (*STEP[:3], STEP[3].astype(np.longdouble), *STEP[4:], NONE))],
        [BEGUN, (Samples(steps=1), (*STEP[:2], STEP[2] - 9, *STEP[3:], NONE))],
        [BEGUN, (Samples(steps=1), (*STEP, NONE)), (Samples(steps=1), (*STEP[:3], STEP[3][..., :2], *STEP[4:], NONE))],
        [BEGUN, (RecordingEnds(), (told(passed(0), passed(1), passed(9)), *ENDS))],
        [BEGUN, (RecordingEnds(), (ALL, NONE + 0.5, *ENDS[1:]))],
        [(RecordingEnds(), (ALL, *ENDS))],
        [BEGUN, (RecordingEnds(), (ALL, *ENDS[1:]))],
        [BEGUN, (RecordingEnds(), (ALL, *(array[:2] for array in ENDS)))],
        [BEGUN, (RecordingEnds(), (told(passed(0)), *ENDS))],
        [BEGUN, (RecordingEnds(), (ALL, NONE + (1 << 40), *ENDS[1:]))],
        [BEGUN, BEGUN, BEGUN],
        [BEGUN, *[(Samples(steps=1), (*STEP, NONE))] * 5000],
        [
            BEGUN,
            (
                Samples(steps=0),
                (*(array[:, :0] for array in STEP[:5]), *STEP[5:7], *(each[:, :0] for each in STEP[7:]), NONE),
            ),
        ],
        [BEGUN, (Samples(steps=1), (np.zeros((3, 9, 3)), *STEP[1:], NONE))],
        [BEGUN, (RecordingEnds(), (ALL, *ENDS)), (RecordingEnds(), (ALL, *ENDS))],
    ],
)
def test_samples_that_no_recorder_can_take_are_no_answer(simulate: Simulate, said: Said):
    rows, process = simulate(*said, (Rows(), (ALL,)), rate_hz=4.0)
    assert {row.status for row in rows} == {"Failed"}
    assert process.ended == 1


def test_episodes_that_failed_beside_others_may_be_recorded_once_more_by_themselves(simulate: Simulate):
    twice = [BEGUN, (Samples(steps=1), (*STEP, NONE)), BEGUN, (Samples(steps=1), (*STEP, NONE))]
    rows, process = simulate(*twice, (RecordingEnds(), (ALL, *ENDS)), (Rows(), (told(),)), rate_hz=4.0)
    assert (rows, process.ended) == ([passed(0), passed(1), passed(2)], 0)


def test_no_row_names_a_file_that_its_process_chose(simulate: Simulate):
    rows, _ = simulate((Rows(), (told(*(passed(k).model_copy(update={"recording": "../0"}) for k in range(3))),)))
    assert rows == [passed(0), passed(1), passed(2)]


def test_rows_that_recordings_ended_with_and_the_others_come_in_the_order_of_the_requests(simulate: Simulate):
    none, place = np.zeros(2, int), np.zeros((2, 3))
    ends = (
        told(collided(2), passed(0)),
        none,
        none == 1,
        place,
        place,
        place,
        none,
        place[:, None, :2],
        np.zeros((2, 7)),
        *[PEOPLE[:2]] * 6,
    )
    said = [(RecordingBegins(lanes=2, control_s=0.05), ()), (RecordingEnds(), ends), (Rows(), (told(passed(1)),))]
    rows, process = simulate(*said, rate_hz=4.0)
    assert (rows, process.ended) == ([passed(0), passed(1), collided(2)], 0)


def test_a_recording_that_ends_without_rows_is_no_answer(simulate: Simulate):
    said = [(RecordingBegins(lanes=3, control_s=0.05), ()), (RecordingEnds(), ()), (Rows(), (told(),))]
    rows, process = simulate(*said, rate_hz=4.0)
    assert process.ended == 1
    assert {row.status for row in rows} == {"Failed"}


LANES = 4
HOSTILE = "b" * 64
SOUND, LEAVES, SLEEPS, INTERRUPTS, TELLS, WRITES, CONNECTS, LOOKS, PRINTS = range(9)
EXITS, COMPLEX, NOTHING, BOOLS, TEXTS, ANNOUNCES = range(9, 15)
DRIVING = ApplicationLaunch(name="hostile", version="1", digest=HOSTILE, package="hostile", launch_file="driving")
KEYS = "/where/keys/are"
needs_bubblewrap = pytest.mark.skipif(
    confinement().level != "bubblewrap" and os.environ.get("CI") != "true", reason=confinement().why or "there"
)


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The test's applications, whose folders are this module's alone."""
    return {HOSTILE: BUNDLES / "hostile", DRIFT: FOLDERS[DRIFT]}


@pytest.fixture(autouse=True)
def keys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_KEYS", KEYS)


def chunk_of(faults: list[int], launch_file: str = "driving") -> Chunk:
    robot = DRIVING.model_copy(update={"launch_file": launch_file})
    requests: list[EpisodeRequest] = [
        pushing(index, world="hand/pen-0", seed=index, fault=str(fault)).model_copy(
            update={"robot": robot, "scenario": ENDLESS}
        )
        for index, fault in enumerate(faults)
    ]
    (chunk,) = plan_chunks(requests, LANES)
    return chunk


Run = Callable[..., list[EpisodeResult]]


@pytest.fixture
def run(bundles: dict[str, Path], pens: dict[str, World]) -> Run:
    """Simulates episodes with these faults in a process of their own."""

    def rows(faults: list[int], launch_file: str = "driving", **more: object) -> list[EpisodeResult]:
        options = {"should_stop": lambda: False, **more}
        lanes = SandboxClient(bundles=bundles, lanes=LANES, engine="auto", **options)  # pyright: ignore[reportArgumentType]
        return lanes.simulate(chunk_of(faults, launch_file), pens).rows()

    return rows


@pytest.fixture(scope="module")
def sound(bundles: dict[str, Path], pens: dict[str, World]) -> list[EpisodeResult]:
    """The rows of sound episodes, simulated in this process."""
    return simulate_lanes(chunk_of([SOUND] * LANES), pens, bundles, lanes=LANES, should_stop=lambda: False)


@pytest.mark.long
def test_rows_and_recordings_are_those_of_a_run_in_this_process(
    run: Run, bundles: dict[str, Path], pens: dict[str, World], sound: list[EpisodeResult]
):
    here, apart = (Recorder(4.0, lambda _: True) for _ in range(2))
    chunk = chunk_of([SOUND] * LANES)
    simulate_lanes(chunk, pens, bundles, lanes=LANES, should_stop=lambda: False, recorder=here)
    assert run([SOUND] * LANES, recorder=apart, rate_hz=4.0) == sound
    for ours, theirs in zip(here.parts(), apart.parts(), strict=True):
        assert {name: values.tobytes() for name, values in ours.items()} == {
            name: values.tobytes() for name, values in theirs.items()
        }


@pytest.mark.long
def test_of_episodes_that_nobody_keeps_no_samples_are_told(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    bundles = {digest: FOLDERS[digest] for digest in (DRIFT, FAULTY)}
    here, apart = (Recorder(4.0, lambda rows: np.isin(rows.index, (1, 3))) for _ in range(2))
    told: list[int] = []
    begin = apart.begin

    def begins(lanes: int, control_s: float) -> None:
        told.append(lanes)
        begin(lanes, control_s)

    monkeypatch.setattr(apart, "begin", begins)
    (chunk,) = plan_chunks([pushing(k, world="hand/pen-0", seed=k, duration_s=1.0 + k) for k in range(LANES)], LANES)
    alone = simulate_lanes(chunk, pens, bundles, lanes=LANES, should_stop=lambda: False, recorder=here)
    wanted = RecordingChoice(always=(1, 3))
    lanes = SandboxClient(bundles, LANES, "auto", lambda: False, rate_hz=4.0, recorder=apart, recorded=wanted)
    assert lanes.simulate(chunk, pens).rows() == alone
    assert told == [2]
    assert apart.episodes == [1, 3]
    assert [_bytes(part) for part in apart.parts()] == [_bytes(part) for part in here.parts()]


def _bytes(columns: Columns) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in columns.items()}


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (EXITS, "controller.step: SystemExit: 0"),
        (INTERRUPTS, "controller.step: KeyboardInterrupt: "),
        (COMPLEX, "controller.step: control of complex128, not of real numbers"),
        (NOTHING, "controller.step: control of object, not of real numbers"),
        (BOOLS, "controller.step: control of bool, not of real numbers"),
        (TEXTS, "controller.step: control of <U1, not of real numbers"),
    ],
)
def test_what_a_controller_raises_or_returns_is_the_row_of_its_lane_alone(
    run: Run, sound: list[EpisodeResult], fault: int, reason: str
):
    rows = run([SOUND, fault, SOUND, SOUND])
    assert (rows[1].status, rows[1].failure_code) == ("Failed", "RobotApplicationCrash")
    assert rows[1].failure_reason.startswith(reason)
    assert [rows[0], *rows[2:]] == [sound[0], *sound[2:]]


def test_an_application_sees_neither_keys_nor_credentials_nor_addresses(run: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    reason = run([TELLS])[0].failure_reason
    assert "PATH" in reason
    assert not any(name in reason for name in ("SIMYARD_KEYS", "SIMYARD_STORE", "AWS_", "PREFECT_"))


@needs_bubblewrap
def test_in_bubblewrap_an_application_has_no_file_to_write_no_network_and_no_parent_to_read(
    run: Run, sound: list[EpisodeResult]
):
    with socket.create_server(("127.0.0.1", 0)):
        wrote, connected, looked, _ = run([WRITES, CONNECTS, LOOKS, SOUND])
    assert wrote == sound[0]  # it could write nowhere
    assert "OSError" in connected.failure_reason or "ConnectionRefusedError" in connected.failure_reason
    assert "SIMYARD_KEYS False" in looked.failure_reason or "PermissionError" in looked.failure_reason


def test_a_robot_that_patches_its_process_changes_no_row_of_another(
    bundles: dict[str, Path], pens: dict[str, World], sound: list[EpisodeResult]
):
    other = DRIVING.model_copy(update={"digest": "9" * 64, "launch_file": "patches"})
    (asked,) = chunk_of([SOUND]).requests
    patching = Chunk(number=1, requests=(asked.model_copy(update={"robot": other}),))
    rows: list[list[EpisodeResult]] = []
    for chunk in (patching, chunk_of([SOUND] * LANES)):
        client = SandboxClient(
            {**bundles, other.digest: BUNDLES / "hostile"}, LANES, "auto", lambda: False, ahead=[patching]
        )
        rows.append(client.simulate(chunk, pens).rows())
    assert rows[0][0].path_length_m == 0.0
    assert rows[1] == sound


def test_an_application_that_announces_more_than_was_asked_for_fails_by_name(run: Run):
    """On 1b6713fb the run made room for what was announced."""
    (row,) = run([ANNOUNCES])
    assert (row.status, row.failure_code) == ("Failed", "RobotApplicationCrash")
    said = "the process that simulates answered what is no answer during "
    assert row.failure_reason.startswith(said)
    assert "a message of 629,145,600 and 0 bytes: at most 1," in row.failure_reason


def test_what_applications_print_is_kept(run: Run, sound: list[EpisodeResult]):
    printed: list[str] = []
    assert run([PRINTS, SOUND, SOUND, SOUND], printed=printed.append) == sound
    assert "I see something" in "".join(printed)


@pytest.mark.long
def test_a_chunk_ahead_that_ends_the_process_takes_no_row_from_the_chunk_before_it(pens: dict[str, World]):
    bundles = {HOSTILE: BUNDLES / "hostile", DRIFT: FOLDERS[DRIFT], FAULTY: FOLDERS[FAULTY]}
    (chunk,) = plan_chunks([pushing(0, world="hand/pen-0", duration_s=1.0)], LANES)
    here, apart = (Recorder(4.0, lambda _: True) for _ in range(2))
    alone = simulate_lanes(chunk, pens, bundles, lanes=LANES, should_stop=lambda: False, recorder=here)
    ahead = [chunk_of([SOUND], "leaves")]
    lanes = SandboxClient(bundles, LANES, "auto", should_stop=lambda: False, rate_hz=4.0, recorder=apart, ahead=ahead)
    assert lanes.simulate(chunk, pens).rows() == alone
    assert [part["pose"].tobytes() for part in apart.parts()] == [part["pose"].tobytes() for part in here.parts()]


@pytest.mark.long
def test_an_application_that_ends_its_process_has_its_row_and_the_others_are_as_without_it(
    run: Run, sound: list[EpisodeResult]
):
    rows = run([SOUND, SOUND, LEAVES, SOUND])
    assert (rows[2].status, rows[2].failure_code) == ("Failed", "RobotApplicationCrash")
    assert rows[2].failure_reason.startswith("the process ended with exit code 0 during controller.step")
    assert [*rows[:2], rows[3]] == [*sound[:2], sound[3]]


@pytest.mark.long
@pytest.mark.parametrize(
    ("launch_file", "reason"),
    [
        ("exits", "hostile: importing hostile/exits.py: SystemExit: 0 (hostile/exits.py, line 6: sys.exit(0))"),
        (
            "interrupts",
            "hostile: importing hostile/interrupts.py: KeyboardInterrupt: "
            " (hostile/interrupts.py, line 4: raise KeyboardInterrupt)",
        ),
        ("leaves", "the process ended with exit code 0 during hostile: importing hostile/leaves.py"),
        ("hangs", "hostile: importing hostile/hangs.py took longer than 2 s (SIMYARD_IMPORT_LIMIT_S)"),
    ],
)
def test_an_application_that_does_not_import_fails_all_its_episodes_with_the_reason(
    run: Run, launch_file: str, reason: str, monkeypatch: pytest.MonkeyPatch
):
    if launch_file == "hangs":
        monkeypatch.setenv("SIMYARD_IMPORT_LIMIT_S", "2")
    rows = run([SOUND, SOUND], launch_file)
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "RobotApplicationCrash")}
    assert {row.failure_reason for row in rows} == {" ".join(reason.split())}


@pytest.mark.long
def test_a_step_that_takes_too_long_is_a_row(run: Run, sound: list[EpisodeResult], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_STEP_LIMIT_S", "3")
    rows = run([SOUND, SLEEPS])
    assert rows[0] == sound[0]
    assert rows[1].failure_reason == "controller.step took longer than 3 s (SIMYARD_STEP_LIMIT_S)"


@pytest.mark.long
def test_an_application_that_hangs_does_not_keep_a_run_from_stopping(run: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(simulator, "_GRACE_S", 1.0)
    begun_s = time.monotonic()
    rows = run([SOUND, SLEEPS], should_stop=lambda: time.monotonic() - begun_s > 8.0)
    assert {row.status for row in rows} == {"Canceled"}


def test_chunks_ahead_that_the_memory_was_too_little_for_are_not_begun_again(
    monkeypatch: pytest.MonkeyPatch, bundles: dict[str, Path], pens: dict[str, World]
):
    asked: list[int] = []

    def rows_of(_: SandboxClient, chunk: Chunk, *given: object) -> list[EpisodeResult]:
        ahead = given[2] if len(given) > 2 else ()
        asked.append(len(ahead) if isinstance(ahead, list) else 0)
        if not asked[-1]:
            return [failed_result(request.index, Failure("RobotApplicationCrash", "")) for request in chunk.requests]
        ended = simulator.SimulatorEnded("it was ended by signal 9", None, "", status=-9)
        ended.beside_others = True
        raise ended

    monkeypatch.setattr(lanes_module, "_too_large_together", set())
    monkeypatch.setattr(SandboxClient, "_rows", rows_of)
    for _ in range(2):  # each chunk has its own
        lanes = SandboxClient(bundles, LANES, "auto", should_stop=lambda: False, ahead=[chunk_of([SOUND])])
        assert len(lanes.simulate(chunk_of([SOUND]), pens)) == 1
    assert asked == [1, 0, 0]
