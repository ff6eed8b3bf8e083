"""Samples of recordings, made by hand."""

import numpy as np


def samples(*indices: int, rows: int = 4) -> dict[str, np.ndarray]:
    """Returns so many samples of each episode; in the last of each nothing was decided."""
    count = rows * len(indices)
    number = np.arange(count)
    return {
        "index": np.repeat(indices, rows),
        "t_s": np.tile(np.arange(rows) / 10, len(indices)),
        "pose": np.stack([number, -number, number / 10], 1).astype(np.float32),
        "velocity": np.stack([number, number + 0.5, -number], 1).astype(np.float32),
        "goal_index": number % 3,
        "acted": np.tile(np.arange(rows) < rows - 1, len(indices)),
        "control": np.stack([number, number + 0.25], 1).astype(np.float32),
        "ranges_m": np.tile(number[:, None], 3).astype(np.float32),
        "impulse_ns": (number % 2).astype(np.float32),
    }
