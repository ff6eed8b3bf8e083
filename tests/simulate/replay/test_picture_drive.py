"""Which pictures a recording keeps: at most so many a second, all of them the camera's own, and the last."""

import numpy as np
import pytest

from tasks.simulate.replay.picture_drive import some_pictures

STEPS = np.arange(0, 101, 2)  # sampled at 10 Hz for five seconds


def _kept(stride: int, pictures_hz: float, size: int = 100, steps: np.ndarray = STEPS) -> list[int]:
    return steps[some_pictures(steps, stride, pictures_hz, size)].tolist()


def test_pictures_are_as_far_apart_as_was_asked_and_the_last_is_kept():
    assert _kept(1, 2.0) == [*range(0, 101, 10)]
    assert _kept(1, 3.0) == [*range(0, 99, 8), 100]  # of samples that are two steps apart, seven are eight
    assert _kept(4, 0.1) == [0, 100]


@pytest.mark.parametrize(
    ("stride", "kept"), [(3, [0, 12, 24, 36, 48, 60, 72, 84, 96]), (7, [0, 14, 28, 42, 56, 70, 84, 98])]
)
def test_only_pictures_that_the_camera_took_where_a_sample_was_taken(stride: int, kept: list[int]):
    assert _kept(stride, 2.0) == kept


def test_of_large_pictures_and_long_episodes_fewer_are_kept():
    assert len(_kept(1, 20.0, size=8 << 20)) <= 8
    assert len(_kept(1, 20.0, size=1 << 40)) == 2  # the first and the last


def test_an_episode_without_samples_has_no_pictures():
    assert _kept(1, 2.0, steps=np.zeros(0, np.int32)) == []
    assert _kept(4, 2.0, steps=np.array([1, 3], np.int32)) == []
