"""Several robots in the world of an episode: how many there may be, and what tells one from another."""

import hashlib

MOST_ROBOTS = 20
STILL_S, STILL_M = 5.0, 0.15
"""Who has not gone so far for so long stands still."""

BLOCKED_M = 0.5
"""Who stands still so near to another one that does may be kept there by it."""


def own_seed(seed: int, number: int) -> int:
    """Returns the seed of a robot's own draws: the episode's for the first one, and alone.

    Args:
        seed: The episode's.
        number: Which of its robots it is, from 0.
    """
    if not number:
        return seed
    return int.from_bytes(hashlib.sha256(f"{seed}/{number}".encode()).digest()[:7])
