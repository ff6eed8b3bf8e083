"""PySocialForce's people: some who walk by the social force among 25 walls, and no robot. Runs where it is.

python -m benchmarks.rivals.social_force_people 8
"""

import sys

import numpy as np
import pysocialforce  # pyright: ignore[reportMissingImports]

from benchmarks.rivals.turns import answer_turns

WALLS, SIDE_M = 25, 12.0


def main() -> None:
    """Answers turns: a step is of all people, as of those among whom a robot would be."""
    draw, people = np.random.default_rng(0), int(sys.argv[1])
    starts, goals = draw.uniform(0.5, SIDE_M - 0.5, (2, people, 2))
    towards = goals - starts
    speeds = 1.3 * towards / np.hypot(*towards.T)[:, None]
    ends = draw.uniform(0.0, SIDE_M, (WALLS, 2))
    walls = [[x, x + 0.4, y, y] for x, y in ends.tolist()]
    state = np.concatenate([starts, speeds, goals], axis=1)
    simulator = pysocialforce.Simulator(state, obstacles=walls)
    fresh = [0]

    def step() -> int:
        # It keeps all states it ever had; from the beginning again it stays as quick as it was.
        if fresh[0] >= 500:
            simulator.peds.ped_states, fresh[0] = simulator.peds.ped_states[:1], 0
        for _ in range(10):
            simulator.step_once()
        fresh[0] += 10
        return 10

    answer_turns(1, step)


if __name__ == "__main__":
    main()
