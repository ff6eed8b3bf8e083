"""The rivals' side of a turn: told a number of seconds, steps for so long and says what it did.

Imported by scripts that run in the rivals' own environments, so it needs nothing but Python.
"""

import json
import sys
import time
from collections.abc import Callable


def answer_turns(robots: int, step: Callable[[], int]) -> None:
    """Answers each line of seconds with the steps of all robots, wall and processor seconds, as a line of JSON.

    Args:
        robots: How many robots a step moves.
        step: Moves all robots at least once, to the end of the work; returns how many times each.
    """
    step()
    _say({"robots": robots})
    for line in sys.stdin:
        wall_s, cpu_s, steps = time.perf_counter(), time.process_time(), 0
        while time.perf_counter() - wall_s < float(line):
            steps += robots * step()
        told = {"steps": steps, "wall_s": time.perf_counter() - wall_s, "cpu_s": time.process_time() - cpu_s}
        _say(told)


def _say(told: dict[str, float]) -> None:
    sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()
