"""Makes the result rows of lanes, as columns: an object a row takes longer than all that is computed of it."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from specs.data.episode import CONTROL_HZ, CONTROL_S, WITHDRAWN, EpisodeRequest, EpisodeResult, unfinished_result
from specs.data.episode_columns import RESULT_KINDS, Cells, EpisodeColumns, field_cells, label_cells
from specs.data.people import FARTHEST_COLLISION_S
from specs.data.physics import physical_factors
from tasks.simulate.application.bundle_code import CrashCode
from tasks.simulate.application.contract import REASONS
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.rooms import Visit, visits
from tasks.simulate.geometry.shortest_path import shortest_paths_m
from tasks.simulate.lane.control_step import NO_CRASH, ROBOT_CRASH, SIMULATION_CRASH, LaneState
from tasks.simulate.lane.person_impact import impacts
from tasks.simulate.lane.shared_world import RobotsState
from tasks.simulate.lane.staging import Lane
from tasks.simulate.lane.walkers import PeopleState
from tasks.simulate.sensors.odometry import ODOMETRY

# One pose in half a simulated second is kept of a failed episode.
POSE_STEPS = CONTROL_HZ // 2
_FINAL = ("final_x_m", "final_y_m", "final_yaw_rad")
# Poses of lanes that are looked at together: 12 MB, of which there are several copies then.
_POSES_AT_ONCE = 1 << 20
# A disc's own way is never so much shorter: the polygons that stand for arcs are off by less.
_SHORTER = 0.95
_LEAST_M = 1e-300  # for a division whose quotient is not used
_CRASHES: dict[int, tuple[CrashCode | Literal[""], str]] = {
    NO_CRASH: ("", ""),
    ROBOT_CRASH: ("RobotApplicationCrash", "controller.step: returned a control that is not finite"),
    SIMULATION_CRASH: ("SimulationApplicationCrash", "the robot's position or velocity is not finite, or beyond 1e10"),
}


def stopped_row(request: EpisodeRequest) -> EpisodeResult:
    """Returns the row of an episode that was stopped before its end; what it had done by then is not kept."""
    return unfinished_result(request.index, "Canceled", failure_code="", failure_reason="stopped before its end")


def withdrawn_row(request: EpisodeRequest) -> EpisodeResult:
    """Returns the row of an episode whose own application asked for the end of its job."""
    return unfinished_result(request.index, "Canceled", failure_code="", failure_reason=WITHDRAWN)


class Ended(NamedTuple):
    """An episode that ended.

    Attributes:
        place: The lane that it was in.
        slices: How many slices it drove, of the last ones.
    """

    lane: Lane
    place: int
    slices: int


def finished_rows(
    ended: Sequence[Ended],
    state: LaneState,
    poses: Sequence[Float32[np.ndarray, "lanes steps 3"]],
    *,
    hull: Hull,
    engine: str = "",
    device: str = "",
) -> EpisodeColumns:
    """Returns the rows of episodes that ended in the same slice.

    Args:
        ended: The episodes, at least one.
        state: All lanes' states, on the host.
        poses: The slices' poses at the ends of their control steps, until that slice; as many as the longest drove.
        hull: The robot's.
        engine: What drove them.
        device: On what.
    """
    at_once = max(1, _POSES_AT_ONCE // sum(each.shape[1] for each in poses))
    groups = [ended[first : first + at_once] for first in range(0, len(ended), at_once)]
    return EpisodeColumns.join([_rows_together(group, state, poses, hull, engine, device) for group in groups])


def _rows_together(  # noqa: PLR0917 - as finished_rows
    ended: Sequence[Ended],
    state: LaneState,
    poses: Sequence[Float32[np.ndarray, "lanes steps 3"]],
    hull: Hull,
    engine: str,
    device: str,
) -> EpisodeColumns:
    """Returns the rows of episodes whose poses memory has room for together; the rest as ``finished_rows``."""
    lanes, at = [each.lane for each in ended], np.array([each.place for each in ended])
    steps, totals, pose = np.asarray(state.step)[at], state.totals, np.asarray(state.body.qpos)[at]
    reasons = [REASONS[reason] for reason in np.asarray(state.reason)[at].tolist()]
    crashes = [_CRASHES[crash] for crash in np.asarray(state.crash)[at].tolist()]
    passed = np.array([reason == "" for reason in reasons])
    ways = _ways(ended, at, steps, poses)
    driven_m = _reals(totals.path_length_m, at)
    reached = np.asarray(state.goal_steps)[at]
    least_m = _reals(totals.min_clearance_m, at)
    fields = {
        "index": Cells(np.array([lane.request.index for lane in lanes], np.int64)),
        "status": label_cells(["Failed" if code else "Completed" for code, _ in crashes]),
        "failure_code": label_cells([code for code, _ in crashes]),
        "failure_reason": label_cells([why for _, why in crashes]),
        "outcome": label_cells(["Passed" if reason == "" else "Failed" for reason in reasons]),
        "outcome_reason": label_cells(reasons),
        "simulated_s": Cells(_seconds(steps)),
        "goals_reached": Cells(_counts(state.goal_index, at)),
        "goals_total": Cells(np.array([len(lane.placement.goals_m) for lane in lanes], np.int64)),
        "path_length_m": Cells(driven_m),
        "goal_times_s": Cells(_seconds(reached[reached > 0]), lengths=np.sum(reached > 0, axis=1)),
        **_measured_ways(lanes, driven_m, passed),
        "collisions": Cells(_counts(totals.collisions, at)),
        "impulse_ns": Cells(_reals(totals.impulse_ns, at)),
        "max_impulse_ns": Cells(_reals(totals.max_impulse_ns, at)),
        "min_clearance_m": Cells(np.where(np.isfinite(least_m), least_m, 0.0)),
        "energy_j": Cells(_reals(totals.energy_j, at)),
        **{name: Cells(pose[:, axis].astype(np.float64)) for axis, name in enumerate(_FINAL)},
        "odometry_error_m": _odometry_errors_m(state, at, pose),
        **_people_columns(lanes, state.people, at, hull),
        **_robots_columns(state.robots, at),
        "metrics": _metrics(state.metrics, at),
        **_room_columns(lanes, ways),
        "trajectory": _trajectories(ways, np.where(passed, -1, steps)),
        "engine": label_cells([engine] * len(lanes)),
        "device": label_cells([device] * len(lanes)),
    }
    return EpisodeColumns.with_defaults(fields, len(lanes))


def _ways(
    ended: Sequence[Ended],
    at: Int[np.ndarray, " ended"],
    steps: Int[np.ndarray, " ended"],
    poses: Sequence[Float32[np.ndarray, "lanes steps 3"]],
) -> Float32[np.ndarray, "ended steps 3"]:
    """Returns the poses at the start and at the end of each control step; who ended earlier stays where it was."""
    driven = np.concatenate([each[at] for each in poses], axis=1)
    lengths = np.cumsum([0, *(each.shape[1] for each in reversed(poses))])
    before = lengths[-1] - lengths[[each.slices for each in ended]]
    number = np.minimum(np.arange(1, int(steps.max()) + 1), steps[:, None])
    starts = np.stack([each.lane.placement.start for each in ended]).astype(np.float32)[:, None]
    moving = np.take_along_axis(driven, (before[:, None] + number - 1)[..., None], axis=1)
    return np.concatenate([starts, np.where((number > 0)[..., None], moving, starts)], axis=1)


def _trajectories(ways: Float32[np.ndarray, "ended steps 3"], steps: Int[np.ndarray, " ended"]) -> Cells:
    """Returns the poses from the start, every half second, to the last; none where the steps are below 0."""
    lengths = np.where(steps < 0, 0, -(-steps // POSE_STEPS) + 1).astype(np.int64)
    lane = np.repeat(np.arange(len(steps)), lengths)
    turn = np.arange(len(lane)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    step = np.minimum(turn * POSE_STEPS, steps[lane])
    poses = ways[lane, step].astype(np.float64).reshape(-1, 3)
    return Cells(np.concatenate([_seconds(step)[:, None], poses], axis=1), lengths=lengths)


def _seconds(steps: Int[np.ndarray, " entries"]) -> Float64[np.ndarray, " entries"]:
    """Returns times after so many control steps, rounded as Python rounds: NumPy's last bits are others."""
    some, which = np.unique(steps, return_inverse=True)
    return np.array([round(step * CONTROL_S, 6) for step in some.tolist()], np.float64)[which]


def _measured_ways(
    lanes: Sequence[Lane], driven_m: Float64[np.ndarray, " ended"], passed: Bool[np.ndarray, " ended"]
) -> dict[str, Cells]:
    """Returns shortest ways, and success weighted by path length (Anderson et al. 2018); None if unknown.

    A robot that is no disc may get through where the disc around it does not. One that passed on a shorter way than the
    disc's gets the shortest of a disc that no robot is narrower than: what is below that cannot be.
    """
    known = [lane.shortest_path_m for lane in lanes]
    there = np.array([length is not None for length in known])
    shortest_m = np.array([length or 0.0 for length in known], np.float64)
    weight = np.where(shortest_m > 0.0, shortest_m / np.maximum(np.maximum(driven_m, shortest_m), _LEAST_M), 1.0)
    shorter = np.flatnonzero(passed & there & (driven_m < _SHORTER * shortest_m)).tolist()
    if shorter:
        some = [lanes[number] for number in shorter]
        ways, placements = [lane.arrays.narrow_ways for lane in some], [lane.placement for lane in some]
        narrow_m = shortest_paths_m(ways, placements, [placement.arrived_m or 0.0 for placement in placements])
        shortest_m[shorter] = np.minimum(shortest_m[shorter], narrow_m)
    return {
        "shortest_path_m": Cells(shortest_m, there=there),
        "spl": Cells(np.where(passed & there, weight, 0.0), there=there),
    }


def _room_columns(lanes: Sequence[Lane], ways: Float32[np.ndarray, "ended steps 3"]) -> dict[str, Cells]:
    """Returns the columns of where episodes took their robots, those in one world looked at together."""
    went: dict[int, Visit] = {}
    groups: dict[int, list[int]] = {}
    for number, lane in enumerate(lanes):
        groups.setdefault(id(lane.arrays.rooms), []).append(number)
    for group in groups.values():
        some = [lanes[number] for number in group]
        known = [lane.shortest_path_m is not None for lane in some]
        found = visits(some[0].arrays.rooms, [lane.placement for lane in some], ways[group, :, :2], known)
        went |= dict(zip(group, found, strict=True))
    visited = [went[number] for number in range(len(lanes))]
    return {
        "rooms_entered": field_cells(RESULT_KINDS["rooms_entered"], [each.entered for each in visited]),
        "rooms_unreachable": field_cells(RESULT_KINDS["rooms_unreachable"], [each.unreachable for each in visited]),
        "rooms_total": Cells(np.array([len(lane.arrays.rooms.names) for lane in lanes], np.int64)),
        "goals_reachable": field_cells(RESULT_KINDS["goals_reachable"], [each.goals_reachable for each in visited]),
    }


def _people_columns(
    lanes: Sequence[Lane], people: PeopleState | None, at: Int[np.ndarray, " ended"], hull: Hull
) -> dict[str, Cells]:
    """Returns how robots met people; nothing of episodes without."""
    if people is None:
        return {}
    met = people.meetings
    factors = [physical_factors(lane.request.environment) or (1.0,) for lane in lanes]
    mass_factors = np.array([mass for mass, *_ in factors], np.float64)
    hardest = impacts(
        hull, mass_factors, *(_reals(each, at) for each in (met.impact_m_s, met.pinned_m_s, met.pressed_ns))
    )
    return {
        "person_contacts": Cells(_counts(met.contacts, at)),
        "person_standing_contacts": Cells(_counts(met.standing_contacts, at)),
        "person_contact_m_s": Cells(_reals(met.contact_m_s, at)),
        "person_energy_j": Cells(hardest.energy_j),
        "person_force_n": Cells(hardest.force_n),
        "person_force_margin": Cells(hardest.force_margin),
        "min_person_m": field_cells(RESULT_KINDS["min_person_m"], _finite(_reals(met.least_m, at))),
        "min_person_collision_s": Cells(np.minimum(_reals(met.collision_s, at), FARTHEST_COLLISION_S)),
        "person_personal_s": Cells(_seconds(_counts(met.personal_steps, at))),
        "person_intimate_s": Cells(_seconds(_counts(met.intimate_steps, at))),
        "person_frozen_s": Cells(_seconds(_counts(met.frozen_steps, at))),
    }


def _robots_columns(robots: RobotsState | None, at: Int[np.ndarray, " ended"]) -> dict[str, Cells]:
    """Returns how robots met others; nothing of those that were alone."""
    if robots is None:
        return {}
    return {
        "robot_contacts": Cells(_counts(robots.contacts, at)),
        "robot_contact_m_s": Cells(_reals(robots.contact_m_s, at)),
        "min_robot_m": field_cells(RESULT_KINDS["min_robot_m"], _finite(_reals(robots.least_m, at))),
    }


def _finite(values: Float64[np.ndarray, " ended"]) -> list[float | None]:
    """Returns values that are numbers; an episode that ended before its first control step has none."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _metrics(metrics: Mapping[str, object], at: Int[np.ndarray, " ended"]) -> Cells:
    """Returns what scenarios measured by themselves, where it is finite."""
    values = np.stack([_reals(each, at) for each in metrics.values()], axis=1) if metrics else np.zeros((len(at), 0))
    there = np.isfinite(values)
    return Cells(values[there], np.nonzero(there)[1], tuple(metrics), np.sum(there, axis=1))


def _odometry_errors_m(state: LaneState, at: Int[np.ndarray, " ended"], pose: np.ndarray) -> Cells:
    """Returns how far robots' believed places are from their true ones; none for robots without odometry."""
    believed = state.sensed[ODOMETRY.name]
    if believed is None:
        return Cells(np.zeros(len(at)), there=np.zeros(len(at), np.bool_))
    off = np.asarray(believed)[at] - pose
    return Cells(np.hypot(off[:, 0], off[:, 1]).astype(np.float64))


def _reals(array: object, at: Int[np.ndarray, " ended"]) -> Float64[np.ndarray, " ended"]:
    return np.asarray(array)[at].astype(np.float64)


def _counts(array: object, at: Int[np.ndarray, " ended"]) -> Int[np.ndarray, " ended"]:
    return np.asarray(array)[at].astype(np.int64)
