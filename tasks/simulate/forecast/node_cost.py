"""What ROS nodes cost: how fast lanes go with them, and how much memory their processes take.

Measured with rospy nodes that answer each scan on two cores: 375 control steps a second with one lane, 740 in all with
8, 620 with 32; 1.3, 2.3 and 6.5 s until they are ready; 32 to 42 MB a process. A node in C++ takes 2 MB.
"""

import os

from tasks.simulate.forecast.cost import Span

# Of a lane alone, and of each of many that share the cores.
_STEP_S, _LANE_STEP_S = 2.7e-3, 1.5e-3
_MEASURED_CORES = 2
_READY_S, _LANE_READY_S = 1.2, 0.17
_NODE_BYTES = 42_000_000
# Nodes that wait for single messages take 10 times as long; in C++ they take half.
_LOW, _HIGH = 0.2, 1.5


def node_bytes() -> int:
    """Returns the memory of a Python node, as far as it shares none with others."""
    return _NODE_BYTES


def nodes_pace(lanes: int, nodes: int) -> Span:
    """Returns how many control steps a second all lanes go in all, with so many nodes each."""
    expected = lanes / _step_s(lanes, nodes)
    return Span(low=_LOW * expected, high=_HIGH * expected)


def nodes_s(episodes: int, lanes: int, steps: int, nodes: int = 1) -> Span:
    """Returns the wall seconds that nodes add to a batch of so many episodes of so many control steps at most."""
    chunks = -(-episodes // lanes)
    ready_s = chunks * (_READY_S + _LANE_READY_S * min(lanes, episodes) * nodes)
    drive_s = chunks * steps * _step_s(min(lanes, episodes), nodes)
    return Span(low=0.3 * (ready_s + drive_s), high=ready_s / _LOW + drive_s / _LOW)


def _step_s(lanes: int, nodes: int) -> float:
    slower = max(1.0, _MEASURED_CORES / (os.cpu_count() or 1))
    return max(_STEP_S, _LANE_STEP_S * lanes * nodes * slower)
