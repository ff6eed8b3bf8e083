"""A replay on its way from the process that simulates: its row and its setting as data, its steps as arrays."""

import numpy as np

from tasks.simulate.process.sent_log import LOG_ARRAYS, log_of, log_parts
from tasks.simulate.process.work import Again
from tasks.simulate.replay.driven_again import DrivenAgain, Setting


def again_parts(again: DrivenAgain) -> tuple[Again, list[np.ndarray]]:
    """Returns what is said of an episode that was driven again, and the arrays that go with it."""
    setting, steps, samples = again.setting, again.steps, again.samples
    if setting is None or steps is None or samples is None:
        return Again(row=again.row, started=False), []
    names = tuple(steps)
    topics, log = (None, []) if again.traffic is None else log_parts(again.traffic)
    said = Again(
        row=again.row,
        started=True,
        arrived_m=setting.arrived_m,
        radius_m=setting.radius_m,
        heights_m=setting.heights_m,
        mount=setting.mount,
        lidar_height_m=setting.lidar_height_m,
        range_m=setting.range_m,
        columns=names,
        topics=topics,
    )
    columns = [np.asarray(each[name]) for each in (steps, samples) for name in names]
    return said, [setting.goals_m, setting.angles_rad, *columns, *log]


def again_of(again: Again, arrays: tuple[np.ndarray, ...]) -> DrivenAgain:
    """Returns the episode whose parts came: the inverse of ``again_parts``."""
    if not again.started:
        return DrivenAgain(again.row)
    traffic = None
    if again.topics is not None:
        arrays, log = arrays[:-LOG_ARRAYS], arrays[-LOG_ARRAYS:]
        traffic = log_of(again.topics, log)
    goals_m, angles_rad, *columns = arrays
    count = len(again.columns)
    setting = Setting(
        goals_m=goals_m,
        arrived_m=again.arrived_m,
        radius_m=again.radius_m,
        heights_m=again.heights_m,
        mount=again.mount,
        lidar_height_m=again.lidar_height_m,
        range_m=again.range_m,
        angles_rad=angles_rad,
    )
    steps, samples = (dict(zip(again.columns, each, strict=True)) for each in (columns[:count], columns[count:]))
    return DrivenAgain(again.row, setting, steps, samples, traffic)
