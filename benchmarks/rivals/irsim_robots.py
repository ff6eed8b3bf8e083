"""IR-SIM's robots: one with 32 rays among 100 obstacles, moved by a control that was given. Runs where IR-SIM is.

Told a number of people, it is among 25 obstacles and so many circles, which avoid each other and the robot (RVO).
"""

import sys
import tempfile
from pathlib import Path

import irsim  # pyright: ignore[reportMissingImports]
import numpy as np

from benchmarks.rivals.turns import answer_turns

OBSTACLES, WALKED_OBSTACLES, RAYS, RANGE_M, HALF_M = 100, 25, 32, 10.0, 6.0


def world(people: int = 0) -> str:
    """Returns a hall of 12 m with boxes strewn about, and some who walk there, as IR-SIM's YAML."""
    obstacles, draw = WALKED_OBSTACLES if people else OBSTACLES, np.random.default_rng(0)
    places = draw.uniform(0.3, 2 * HALF_M - 0.3, (4 * obstacles, 2))
    free = [place for place in places if np.hypot(*(place - HALF_M)) > 1.2][:obstacles]
    boxes = "\n".join(
        f"  - shape: {{name: rectangle, length: {draw.uniform(0.1, 0.5):.3f}, width: {draw.uniform(0.1, 0.5):.3f}}}\n"
        f"    state: [{x:.3f}, {y:.3f}, {draw.uniform(0, 3):.3f}]"
        for x, y in free
    )
    return (
        f"world: {{height: {2 * HALF_M}, width: {2 * HALF_M}, step_time: 0.05, control_mode: auto}}\n"
        "robot:\n  - kinematics: {name: diff}\n    shape: {name: circle, radius: 0.18}\n"
        f"    state: [{HALF_M}, {HALF_M}, 0]\n    behavior: {{name: dash}}\n    sensors:\n"
        f"      - {{name: lidar2d, range_min: 0, range_max: {RANGE_M}, angle_range: 6.28, number: {RAYS}}}\n"
        f"obstacle:\n{boxes}\n{_walking(people) if people else ''}"
    )


def _walking(people: int) -> str:
    """Returns some who walk to goals that are drawn, as a person does: 1.3 m/s at most, and 0.25 m wide."""
    low, high = f"[0.5, 0.5, {-np.pi}]", f"[{2 * HALF_M - 0.5}, {2 * HALF_M - 0.5}, {np.pi}]"
    return (
        f"  - number: {people}\n    distribution: {{name: random, range_low: {low}, range_high: {high}}}\n"
        "    kinematics: {name: omni}\n    shape: {name: circle, radius: 0.25}\n    vel_max: [1.3, 1.3]\n"
        f"    behavior: {{name: rvo, wander: True, range_low: {low}, range_high: {high}, vxmax: 1.3, vymax: 1.3}}\n"
    )


def main() -> None:
    """Answers turns."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hall.yaml"
        path.write_text(world(*map(int, sys.argv[1:])))
        env = irsim.make(str(path), headless=True, log_level="ERROR")
        action = np.array([[0.0], [0.5]])  # it turns where it stands: a robot that has hit something stays for ever

        def step() -> int:
            for _ in range(10):
                env.step(action)
                env.get_lidar_scan()
            return 10

        answer_turns(1, step)


if __name__ == "__main__":
    main()
