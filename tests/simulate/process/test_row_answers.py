"""Rows that a process answers with are read as a stranger's: what is none, or of other episodes, is no answer."""

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from specs.data.column_bytes import encode_columns
from specs.data.episode import EpisodeResult
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.sandbox import sandbox_client as lanes_module
from tasks.simulate.sandbox.protocol import Answer, RecordingBegins, RecordingEnds, Rows, Samples, SentWorlds
from tasks.simulate.sandbox.sandbox_client import SandboxClient
from tasks.simulate.sandbox.simulator import SimulatorEnded, Told
from tests.factories.episodes import collided, passed
from tests.factories.simulations import pushing

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
ENDS = (NONE, NONE == 1, PLACE, PLACE, PLACE, NONE, PLACE[:, None, :2], np.zeros((3, 7)))
STEP = (PLACE[:, None], PLACE[:, None], NONE[:, None], PLACE[:, None], PLACE[:, None], PLACE, PLACE, np.zeros((3, 1)))
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
            (Samples(steps=1), (*STEP[:4], np.zeros((3, 1, 5_000)), *STEP[5:6], np.zeros((3, 5_000)), STEP[7], NONE)),
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
        [BEGUN, (Samples(steps=0), (*(array[:, :0] for array in STEP[:5]), PLACE, PLACE, np.zeros((3, 0)), NONE))],
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
    )
    said = [(RecordingBegins(lanes=2, control_s=0.05), ()), (RecordingEnds(), ends), (Rows(), (told(passed(1)),))]
    rows, process = simulate(*said, rate_hz=4.0)
    assert (rows, process.ended) == ([passed(0), passed(1), collided(2)], 0)


def test_a_recording_that_ends_without_rows_is_no_answer(simulate: Simulate):
    said = [(RecordingBegins(lanes=3, control_s=0.05), ()), (RecordingEnds(), ()), (Rows(), (told(),))]
    rows, process = simulate(*said, rate_hz=4.0)
    assert process.ended == 1
    assert {row.status for row in rows} == {"Failed"}
