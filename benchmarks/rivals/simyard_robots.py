"""Simyard's robots: 256 on an engine, with 32 rays among 100 obstacles or 25 and some people, as a batch runs them.

python -m benchmarks.rivals.simyard_robots planar [8]
"""

import sys

from benchmarks.rivals.turns import answer_turns
from tasks.simulate.devices import prepare_devices

ROBOTS, OBSTACLES, WALKED_OBSTACLES, TOGETHER = 256, 100, 25, 100


def main() -> None:
    """Answers turns."""
    prepare_devices()
    from benchmarks.simulation.engine_variants import Ours  # noqa: PLC0415 - after JAX's settings
    from specs.data.people import People  # noqa: PLC0415 - beside it

    engine, *people = sys.argv[1:]
    among = People(count=int(people[0])) if people else None
    ours = Ours(engine, ROBOTS, WALKED_OBSTACLES if people else OBSTACLES, among)
    answer_turns(ROBOTS, lambda: ours.run(TOGETHER))


if __name__ == "__main__":
    main()
