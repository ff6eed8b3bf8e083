"""A log comes out of the process that simulates as it went in, and nothing else is taken for one."""

import numpy as np
import pytest

from tasks.simulate.sandbox.protocol import MessageRefused, log_of, log_parts
from tests.ros.bag.tracks import log


def test_a_log_comes_back_as_it_was():
    assert log_of(*log_parts(log())) == log()


@pytest.mark.parametrize("which", range(4))
def test_parts_that_do_not_fit_together_are_refused(which: int):
    topics, arrays = log_parts(log())
    arrays[which] = arrays[which][:-1]
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(topics, arrays)


def test_a_topic_that_there_is_not_is_refused():
    topics, arrays = log_parts(log())
    arrays[1] = np.full_like(arrays[1], len(topics))
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(topics, arrays)
