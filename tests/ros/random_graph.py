"""Graphs of nodes that have one order of events, drawn at random: parts of the courier, and of the trials of rclpy."""

import random

Part = dict[str, object]
_NOTHING: Part = {
    "threads": False,
    "sleep_s": 0.0,
    "answers": "",
    "asks": "",
    "reads": "",
    "writes": "",
    "timer_s": 0.0,
}


def part(**does: object) -> Part:
    """Returns a node that does this."""
    return {**_NOTHING, **does}


def random_graph(seed: int) -> dict[str, Part]:
    """Returns a tree of nodes: each reads the scan or what one before it writes, and may ask a node of its own.

    Two that tell a third one something in one control step do so in the order that they end in, as on a robot.
    """
    draw, graph = random.Random(seed), dict[str, Part]()  # noqa: S311 - no secret
    count = draw.randint(1, 3)
    for k in range(count):
        reads = draw.choice(["scan", *(f"hop{j}" for j in range(k))])
        own: Part = {"threads": draw.random() < 0.5, "sleep_s": draw.choice([0.0, 0.01, 0.03])}
        graph[f"n{k}"] = part(**own, reads=reads, writes=f"hop{k}", timer_s=draw.choice([0.0, 0.1, 0.15]))
        if draw.random() < 0.5:
            graph[f"n{k}"]["asks"] = f"count{k}"
            graph[f"a{k}"] = part(**own, answers=f"count{k}")
    graph[f"n{count - 1}"]["writes"] = "cmd_vel"
    return graph
