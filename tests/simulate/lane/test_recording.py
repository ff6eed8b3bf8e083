"""Which episodes are recorded follows from how they end, and from who asked for them."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from specs.data.episode import EpisodeResult, unfinished_result
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.lane import recording
from tasks.simulate.lane.recording import ArrayStore, Columns, Ends, Recorder, RecordingChoice
from tasks.simulate.plan.chunks import Chunk
from tests.factories.episodes import collided, crashed, passed
from tests.factories.simulations import pushing, simulate_lanes
from tests.simulate.conftest import FOLDERS, PUSHER_LANES

ROWS = EpisodeColumns.of(
    [
        passed(0),
        collided(1),
        crashed(2),
        passed(3),
        unfinished_result(4, "Canceled", failure_code="", failure_reason=""),
    ]
)


@pytest.mark.parametrize(
    ("choice", "chosen"),
    [
        (RecordingChoice(), []),
        (RecordingChoice(failed=True), [1, 2]),
        (RecordingChoice(always=(3, 4)), [3]),
        (RecordingChoice(always=(0, 4), failed=True), [0, 1, 2]),
    ],
)
def test_episodes_that_were_asked_for_or_failed_are_recorded_if_they_came_to_an_end(
    choice: RecordingChoice, chosen: list[int]
):
    assert ROWS.index[choice.chosen(ROWS)].tolist() == chosen


ARRAYS = st.lists(arrays(st.sampled_from([np.float32, np.int32, np.bool_]), array_shapes(min_side=0)), max_size=6)

OPEN = Path("/proc/self/fd")


@given(ARRAYS, st.integers(0, 200))
def test_arrays_come_back_as_they_were(given_: list[np.ndarray], memory_bytes: int):
    overflow = ArrayStore(memory_bytes)
    kept = [overflow.keep(array) for array in given_]
    for array, each in zip(given_, kept, strict=True):
        back = overflow.get(each)
        assert (back.dtype, back.shape) == (array.dtype, array.shape)
        assert back.tobytes() == array.tobytes()
    late = overflow.keep(np.arange(5))
    assert overflow.get(late).tolist() == [0, 1, 2, 3, 4]


def test_a_view_of_every_other_row_is_kept_whole():
    array = np.arange(40, dtype=np.float32).reshape(8, 5)
    overflow = ArrayStore(0)
    assert np.array_equal(overflow.get(overflow.keep(array[::2])), array[::2])


@pytest.mark.skipif(not OPEN.exists(), reason="counts open files as Linux tells them")
def test_a_thousand_arrays_need_one_file():
    before = len(list(OPEN.iterdir()))
    overflow = ArrayStore(100)
    kept = [overflow.keep(np.full(64, number)) for number in range(1000)]
    assert all(overflow.get(each)[0] == number for number, each in enumerate(kept))
    assert len(list(OPEN.iterdir())) - before <= 3


def test_row_bytes_are_those_of_one_entry():
    assert ArrayStore(0).keep(np.zeros((4, 3, 2), np.float32)).row_bytes == 24


CONTROL_S, ACTUATORS, RAYS, PEOPLE = 0.05, 2, 3, 4


class Steps(NamedTuple):
    pose: np.ndarray
    velocity: np.ndarray
    goal_index: np.ndarray
    control: np.ndarray
    ranges_m: np.ndarray
    impulse_ns: np.ndarray
    people_m: np.ndarray
    robots_m: np.ndarray
    boxes_m: np.ndarray


class Drive(NamedTuple):
    """All that lanes did, and in which slices it was told."""

    all: Steps
    ends: Ends
    slices: list[int]
    stride: int


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    slices = draw(st.lists(st.integers(1, 5), min_size=1, max_size=5))
    lanes, total = draw(st.integers(1, 3)), sum(slices)
    rng = np.random.default_rng(draw(st.integers(0, 99)))

    def drawn(*shape: int) -> np.ndarray:
        return rng.normal(size=(lanes, *shape)).astype(np.float32)

    steps = Steps(
        pose=drawn(total, 3),
        velocity=drawn(total, 3),
        goal_index=rng.integers(0, 4, (lanes, total)).astype(np.int32),
        control=drawn(total, ACTUATORS),
        ranges_m=drawn(total, RAYS),
        impulse_ns=rng.random((lanes, total)).astype(np.float32),
        people_m=drawn(total, PEOPLE, 2),
        robots_m=drawn(total, 1, 2),
        boxes_m=drawn(total, 2, 2),
    )
    crashed = np.array(draw(st.lists(st.booleans(), min_size=lanes, max_size=lanes)))
    done = [draw(st.integers(0 if crash else 1, total - crash)) for crash in crashed]
    ends = Ends(
        steps=np.array(done),
        crashed=crashed,
        start=drawn(3),
        pose=drawn(3),
        velocity=drawn(3),
        goal_index=np.arange(lanes),
        goals_m=rng.normal(size=(lanes, 3, 2)),
        lidars=rng.normal(size=(lanes, 7)),
        people_start_m=drawn(PEOPLE, 2),
        people_m=drawn(PEOPLE, 2),
        robots_start_m=drawn(1, 2),
        robots_m=drawn(1, 2),
        boxes_start_m=drawn(2, 2),
        boxes_m=drawn(2, 2),
    )
    for lane, last in enumerate(done):  # a lane that came to its end stays as it is
        begun = (ends.start[lane], 0.0, ends.people_start_m[lane], ends.robots_start_m[lane], ends.boxes_start_m[lane])
        kept = (
            (ends.pose, steps.pose),
            (ends.velocity, steps.velocity),
            (ends.people_m, steps.people_m),
            (ends.robots_m, steps.robots_m),
            (ends.boxes_m, steps.boxes_m),
        )
        for (mine, all_), first in zip(kept, begun, strict=True):
            mine[lane] = all_[lane, last - 1] if last else first
            all_[lane, last:] = mine[lane]
    return Drive(steps, ends, slices, draw(st.integers(1, 4)))


def recorded(drive: Drive, *lanes: int, rate_hz: float = 0.0) -> list[Columns]:
    kept = set(lanes)
    recorder = Recorder(
        rate_hz or 1.0 / (drive.stride * CONTROL_S), lambda rows: np.isin(rows.index - 70, sorted(kept))
    )
    recorder.begin(len(drive.ends.steps), CONTROL_S)
    first = 0
    for length in drive.slices:
        done = np.minimum(drive.ends.steps, first + length)
        idle = np.pad(done, (0, 2))  # lanes that only fill the program
        part = Steps(*(_with_idle(each[:, first : first + length]) for each in drive.all))
        recorder.keep(part, idle)
        first += length
    recorder.end(drive.ends, [passed(70 + lane) for lane in range(len(drive.ends.steps))])
    assert recorder.episodes == [70 + lane for lane in sorted(kept)]
    return list(recorder.parts())


def _with_idle(array: np.ndarray) -> np.ndarray:
    """Returns an array of lanes with two lanes more, which only fill the program."""
    return np.concatenate([array, np.zeros((2, *array.shape[1:]), array.dtype)])


def by_hand(drive: Drive, lane: int) -> list[dict[str, Any]]:
    end, crashed = int(drive.ends.steps[lane]), bool(drive.ends.crashed[lane])
    rows: list[dict[str, Any]] = []
    for step in sorted({*range(0, end, drive.stride), end}):
        pushed = drive.all.impulse_ns[lane, step : min(step + drive.stride, end)] if step < end else np.zeros(0)
        at = step - 1
        acted = step < end or crashed
        rows.append(
            {
                "t_s": round(step * CONTROL_S, 6),
                "pose": drive.all.pose[lane, at] if step else drive.ends.start[lane],
                "velocity": drive.all.velocity[lane, at] if step else np.zeros(3),
                "people_m": drive.all.people_m[lane, at] if step else drive.ends.people_start_m[lane],
                "robots_m": drive.all.robots_m[lane, at] if step else drive.ends.robots_start_m[lane],
                "boxes_m": drive.all.boxes_m[lane, at] if step else drive.ends.boxes_start_m[lane],
                "acted": acted,
                "control": drive.all.control[lane, step] if acted else None,
                "ranges_m": drive.all.ranges_m[lane, step] if acted else None,
                "impulse_ns": pushed.sum(dtype=np.float32),
                "goal_m": drive.ends.goals_m[lane, min(_goal(drive, lane, step), 2)],
                "lidar": drive.ends.lidars[lane],
            }
        )
    return rows


def _goal(drive: Drive, lane: int, step: int) -> int:
    if step == int(drive.ends.steps[lane]):
        return int(drive.ends.goal_index[lane])
    return int(drive.all.goal_index[lane, step - 1]) if step else 0


def require_same(columns: Columns, drive: Drive, lane: int) -> None:
    mine = columns["index"] == 70 + lane
    expected = by_hand(drive, lane)
    assert mine.sum() == len(expected)
    for number, row in enumerate(expected):
        for name, value in row.items():
            if value is not None:
                np.testing.assert_allclose(columns[name][mine][number], value, rtol=1e-6, err_msg=f"{name} {number}")


@given(drives())
def test_samples_are_those_that_one_would_take_by_hand(drive: Drive):
    lanes = range(len(drive.ends.steps))
    (columns,) = recorded(drive, *lanes)
    for lane in lanes:
        require_same(columns, drive, lane)
    assert list(columns["index"]) == sorted(columns["index"])
    assert {len(values) for values in columns.values()} == {len(columns["index"])}


@given(drives())
def test_what_does_not_fit_into_memory_comes_out_the_same(drive: Drive):
    (whole,) = recorded(drive, *range(len(drive.ends.steps)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "_MEMORY_BYTES", 40)
        patch.setattr(recording, "_PART_BYTES", 1)
        parts = recorded(drive, *range(len(drive.ends.steps)))
    assert len(parts) == len(drive.ends.steps)
    for name, values in whole.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), values)


@given(drives(), st.sampled_from([5e-324, 1e-12, 1e-3]))
def test_the_lowest_rate_keeps_beginning_and_end_and_takes_no_room(drive: Drive, rate_hz: float):
    total = sum(drive.slices)
    expected = recorded(drive._replace(stride=total), 0)
    found = recorded(drive, 0, rate_hz=rate_hz)
    assert len(found[0]["index"]) <= 2
    for name, values in expected[0].items():
        np.testing.assert_array_equal(found[0][name], values)


@pytest.mark.parametrize(("rate_hz", "times_s"), [(15.0, [0.0, 0.05, 0.1]), (7.0, [0.0, 0.15, 0.3])])
def test_a_rate_is_kept_as_the_nearest_whole_number_of_steps(rate_hz: float, times_s: list[float]):
    recorder, steps, lanes = Recorder(rate_hz, lambda _: True), 9, 1
    recorder.begin(lanes, CONTROL_S)
    three, one = np.zeros((lanes, steps, 3), np.float32), np.zeros((lanes, steps), np.float32)
    people = np.zeros((lanes, steps, 0, 2), np.float32)
    recorder.keep(
        Steps(three, three, one.astype(np.int32), three, three, one, people, people, people), np.array([steps])
    )
    whole, none = np.array([steps]), np.zeros(lanes, bool)
    goals, lidars = np.zeros((lanes, 1, 2)), np.zeros((lanes, 7))
    first = three[:, 0]
    driven = whole, none, first, first, first, np.zeros(lanes, int)
    recorder.end(Ends(*driven, goals, lidars, *[people[:, 0]] * 6), [passed(70)])
    (columns,) = recorder.parts()
    assert columns["t_s"][:3].tolist() == times_s


@given(drives())
def test_only_wanted_episodes_are_given_away(drive: Drive):
    assert recorded(drive) == []
    (columns,) = recorded(drive, 0)
    assert set(columns["index"]) == {70}
    require_same(columns, drive, 0)


def drive_pushers(pens: dict[str, World], faults: list[str], rate_hz: float) -> tuple[list[EpisodeResult], Recorder]:
    requests = tuple(
        pushing(k, world=f"hand/pen-{k % 3}", seed=k, fault=fault, duration_s=2.0 + k / 10)
        for k, fault in enumerate(faults)
    )
    recorder = Recorder(rate_hz, lambda _: True)
    rows = simulate_lanes(
        Chunk(number=0, requests=requests),
        pens,
        FOLDERS,
        lanes=PUSHER_LANES,
        should_stop=lambda: False,
        recorder=recorder,
    )
    return rows, recorder


def test_a_simulated_lane_is_recorded_from_its_start_to_its_end(pens: dict[str, World]):
    rows, recorder = drive_pushers(pens, ["0", "0", "0"], 20.0)
    (columns,) = recorder.parts()
    for row in rows:
        mine = {name: values[columns["index"] == row.index] for name, values in columns.items()}
        assert mine["t_s"].tolist() == pytest.approx([0.05 * k for k in range(round(row.simulated_s / 0.05) + 1)])
        assert tuple(mine["pose"][-1].tolist()) == (row.final_x_m, row.final_y_m, row.final_yaw_rad)
        drawn = {round(pose[0], 3): pose[1:] for pose in row.trajectory}
        seen = dict(zip(mine["t_s"].round(3).tolist(), map(tuple, mine["pose"].tolist()), strict=True))
        assert {t_s: seen[t_s] for t_s in drawn} == drawn
        assert mine["impulse_ns"].sum() == pytest.approx(row.impulse_ns, rel=1e-5)
        assert mine["acted"].tolist() == [True] * (len(mine["t_s"]) - 1) + [False]
        # It bumps about in small rooms: what it sees is no farther than the room is wide.
        assert (mine["ranges_m"][:-1] < 6.0).all()
        np.testing.assert_allclose(mine["control"][:-1, 2], 1.2 * np.sin(0.9 * mine["t_s"][:-1]), atol=1e-5)


def test_half_the_rate_keeps_every_second_sample_and_all_of_the_contacts(pens: dict[str, World]):
    (every,) = drive_pushers(pens, ["0", "0"], 20.0)[1].parts()
    (half,) = drive_pushers(pens, ["0", "0"], 10.0)[1].parts()
    for index in (0, 1):
        whole, part = every["index"] == index, half["index"] == index
        np.testing.assert_array_equal(half["pose"][part][:-1], every["pose"][whole][:-1:2])
        np.testing.assert_array_equal(half["ranges_m"][part][:-1], every["ranges_m"][whole][:-1:2])
        assert half["impulse_ns"][part].sum() == pytest.approx(every["impulse_ns"][whole].sum(), rel=1e-5)


def test_a_crash_shows_the_control_that_did_it(pens: dict[str, World]):
    rows, recorder = drive_pushers(pens, ["0", "1"], 7.0)
    (columns,) = recorder.parts()
    assert rows[1].failure_code == "RobotApplicationCrash"
    last = np.flatnonzero(columns["index"] == 1)[-1]
    assert columns["t_s"][last] == rows[1].simulated_s
    assert columns["acted"][last]
    assert np.isnan(columns["control"][last]).all()
    assert not columns["acted"][np.flatnonzero(columns["index"] == 0)[-1]]
    assert np.isfinite(columns["impulse_ns"]).all()


def test_recording_changes_no_result(pens: dict[str, World]):
    rows, _ = drive_pushers(pens, ["0", "1", "2"], 5.0)
    requests = tuple(pushing(k, world=f"hand/pen-{k}", seed=k, fault=str(k), duration_s=2.0 + k / 10) for k in range(3))
    chunk = Chunk(number=0, requests=requests)
    assert rows == simulate_lanes(chunk, pens, FOLDERS, lanes=PUSHER_LANES, should_stop=lambda: False)
