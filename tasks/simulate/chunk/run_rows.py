"""What a run gives at its end: the rows of its lanes, with what their controllers on the host know besides."""

import contextlib
from collections.abc import Generator, Sequence

import numpy as np
from jaxtyping import Float32

from specs.data.episode import EpisodeResult
from tasks.simulate.chunk.job_tags import give_tags
from tasks.simulate.devices import device_kind
from tasks.simulate.engine.program import Program, Run
from tasks.simulate.host.controllers import HostControllers, TagsJobs
from tasks.simulate.lane.lane_state import NO_CRASH, LaneState
from tasks.simulate.lane.result_rows import Ended, finished_rows, withdrawn_row
from tasks.simulate.lane.samples import Ends
from tasks.simulate.lane.staging import Lane, filled_up
from tasks.simulate.sensor.lidar import Lidar, ray_angles


@contextlib.contextmanager
def open_run(run: Run) -> Generator[Run]:
    """Gives a run, and ends its controllers on the host afterwards, whatever happened."""
    try:
        yield run
    finally:
        if run.host is not None:
            run.host.close()


def lane_row(  # noqa: PLR0917 - a lane of a run
    program: Program,
    host: HostControllers | None,
    lane: Lane,
    position: int,
    state: LaneState,
    poses: Sequence[Float32[np.ndarray, "lanes steps 3"]],
) -> EpisodeResult:
    """Returns the row of a lane that is done, with what drove it; the tags that it gave to its job are given on.

    Args:
        program: That ran it.
        host: Controllers on the host, which may know why it crashed, or that it asked for its end.
        lane: The episode.
        position: The lane's position in the chunk.
        state: All lanes' states, on the host.
        poses: The slices' poses at the ends of their control steps.
    """
    ended = [Ended(lane, position, len(poses))]
    (row,) = finished_rows(ended, state, poses, engine=program.engine, device=device_kind())
    if host is None:
        return row
    if isinstance(host, TagsJobs):
        give_tags(lane.request.index, host.tags(position))
    if position in host.cancelled:
        return withdrawn_row(lane.request)
    known = {"failure_reason": host.crashes[position]} if position in host.crashes else {}
    return row.model_copy(update={**host.measures(position), **known})


def lane_ends(lanes: Sequence[Lane], state: LaneState) -> Ends:
    """Returns how lanes ended, for their recorder."""
    most_goals = max(len(lane.placement.goals_m) for lane in lanes)
    return Ends(
        steps=np.asarray(state.step),
        crashed=np.asarray(state.crash) != NO_CRASH,
        start=np.stack([lane.placement.start for lane in lanes]),
        pose=np.asarray(state.body.qpos),
        velocity=np.asarray(state.body.qvel),
        goal_index=np.asarray(state.goal_index),
        goals_m=np.stack([filled_up(lane.placement.goals_m, most_goals) for lane in lanes]),
        lidars=np.array([_lidar_numbers(lane.lidar) for lane in lanes]),
    )


def _lidar_numbers(lidar: Lidar) -> tuple[float, ...]:
    """Returns a lidar as ``Ends.lidars`` has it."""
    angles = ray_angles(lidar).astype(np.float64)
    first_rad = float(angles[0]) if len(angles) else 0.0
    step_rad = float(angles[-1] - angles[0]) / (len(angles) - 1) if len(angles) > 1 else 0.0
    mount = (float(lidar.x_m), float(lidar.y_m), float(lidar.yaw_rad))
    return (*mount, lidar.height_m, lidar.range_m, first_rad, step_rad)
