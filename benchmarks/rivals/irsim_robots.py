"""IR-SIM's robots: one with 32 rays among 100 obstacles, moved by a control that was given. Runs where IR-SIM is."""

import tempfile
from pathlib import Path

import irsim  # pyright: ignore[reportMissingImports]
import numpy as np

from benchmarks.rivals.turns import answer_turns

OBSTACLES, RAYS, RANGE_M, HALF_M = 100, 32, 10.0, 6.0


def world() -> str:
    """Returns a hall of 12 m with boxes strewn about, as IR-SIM's YAML."""
    draw = np.random.default_rng(0)
    places = draw.uniform(0.3, 2 * HALF_M - 0.3, (4 * OBSTACLES, 2))
    free = [place for place in places if np.hypot(*(place - HALF_M)) > 1.2][:OBSTACLES]
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
        f"obstacle:\n{boxes}\n"
    )


def main() -> None:
    """Answers turns."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hall.yaml"
        path.write_text(world())
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
