"""Simyard's robots: 256 on an engine, with 32 rays among 100 obstacles, as a batch runs them.

python -m benchmarks.rivals.simyard_robots planar
"""

import sys

from benchmarks.rivals.turns import answer_turns
from tasks.simulate.devices import prepare_devices

ROBOTS, OBSTACLES, TOGETHER = 256, 100, 100


def main() -> None:
    """Answers turns."""
    prepare_devices()
    from benchmarks.simulation.engine_variants import Ours  # noqa: PLC0415 - after JAX's settings

    ours = Ours(sys.argv[1], ROBOTS, OBSTACLES)
    answer_turns(ROBOTS, lambda: ours.run(TOGETHER))


if __name__ == "__main__":
    main()
