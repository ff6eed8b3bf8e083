"""Makes the result row of a lane."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float32

from specs.data.episode import CONTROL_HZ, CONTROL_S, WITHDRAWN, EpisodeRequest, EpisodeResult, unfinished_result
from tasks.simulate.application.code import CrashCode
from tasks.simulate.application.contract import REASONS
from tasks.simulate.lane.lane_state import NO_CRASH, ROBOT_CRASH, SIMULATION_CRASH, LaneState
from tasks.simulate.lane.staging import Lane
from tasks.simulate.sensor.odometry import ODOMETRY
from tasks.simulate.surroundings.rooms import visit

# One pose in half a simulated second is kept of a failed episode.
POSE_STEPS = CONTROL_HZ // 2
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


def finished_row(
    lane: Lane, position: int, state: LaneState, poses: Sequence[Float32[np.ndarray, "lanes steps 3"]]
) -> EpisodeResult:
    """Returns the row of a lane that is done.

    Args:
        lane: The episode.
        position: The lane's position in the chunk.
        state: All lanes' states, on the host.
        poses: The slices' poses at the ends of their control steps.
    """
    reason, (code, why) = REASONS[int(state.reason[position])], _CRASHES[int(state.crash[position])]
    steps, tally, pose, passed = int(state.step[position]), state.tally, state.body.qpos[position], reason == ""
    driven = float(tally.path_length_m[position])
    way = _way(lane, position, steps, poses)
    rooms = lane.stage.rooms
    went = visit(rooms, lane.placement, way[:, :2], known_way=lane.shortest_path_m is not None)
    return EpisodeResult(
        index=lane.request.index,
        status="Failed" if code else "Completed",
        failure_code=code,
        failure_reason=why,
        outcome="Passed" if passed else "Failed",
        outcome_reason=reason,
        simulated_s=round(steps * CONTROL_S, 6),
        goals_reached=int(state.goal_index[position]),
        goals_total=len(lane.placement.goals_m),
        path_length_m=driven,
        goal_times_s=tuple(round(int(step) * CONTROL_S, 6) for step in state.goal_steps[position] if step > 0),
        shortest_path_m=lane.shortest_path_m,
        spl=_spl(lane.shortest_path_m, driven, passed=passed),
        collisions=int(tally.collisions[position]),
        impulse_ns=float(tally.impulse_ns[position]),
        max_impulse_ns=float(tally.max_impulse_ns[position]),
        min_clearance_m=_finite(float(tally.min_clearance_m[position])),
        energy_j=float(tally.energy_j[position]),
        final_x_m=float(pose[0]),
        final_y_m=float(pose[1]),
        final_yaw_rad=float(pose[2]),
        odometry_error_m=_odometry_error_m(state, position),
        metrics={name: float(each[position]) for name, each in state.metrics.items() if np.isfinite(each[position])},
        rooms_entered=went.entered,
        rooms_unreachable=went.unreachable,
        rooms_total=len(rooms.names),
        goals_reachable=went.goals_reachable,
        trajectory=() if passed else _trajectory(way),
    )


def _way(
    lane: Lane, position: int, steps: int, poses: Sequence[Float32[np.ndarray, "lanes steps 3"]]
) -> Float32[np.ndarray, "steps 3"]:
    """Returns the pose at the start and at the end of each control step."""
    start = lane.placement.start.astype(np.float32)[None]
    return np.concatenate([start, *(each[position] for each in poses)])[: steps + 1]


def _trajectory(driven: Float32[np.ndarray, "steps 3"]) -> tuple[tuple[float, float, float, float], ...]:
    """Returns the poses from the start, every half second, to the last."""
    kept = sorted({*range(0, len(driven), POSE_STEPS), len(driven) - 1})
    return tuple((round(k * CONTROL_S, 6), float(driven[k, 0]), float(driven[k, 1]), float(driven[k, 2])) for k in kept)


def _spl(shortest_m: float | None, driven_m: float, *, passed: bool) -> float | None:
    """Returns success weighted by path length (Anderson et al. 2018); None where no shortest way is known."""
    if shortest_m is None:
        return None
    if not passed:
        return 0.0
    return shortest_m / max(driven_m, shortest_m) if shortest_m > 0.0 else 1.0


def _odometry_error_m(state: LaneState, position: int) -> float | None:
    """Returns how far the robot's believed place is from its true one; None for a robot without odometry."""
    believed = state.sensed[ODOMETRY.name]
    if believed is None:
        return None
    return float(np.hypot(*(believed[position] - state.body.qpos[position])[:2]))


def _finite(value: float) -> float:
    return value if np.isfinite(value) else 0.0
