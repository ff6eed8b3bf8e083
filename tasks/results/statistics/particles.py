"""Points of what a search varies, and plain draws of them.

Every number follows from the search's seed and a key, so that whoever knows both draws it again.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

Scores = Float64[np.ndarray, "particles"]
"""How far each episode was from failing; below 0 it failed."""


class Space(NamedTuple):
    """What varies.

    Attributes:
        smooth: How many coordinates are normal numbers, along which chains go in small steps.
        drawn: How many are uniform numbers that are drawn anew or kept, such as a world and a seed; at least 1.
        values: Of the first of those that are drawn, each one's number of values, such as worlds; the others have none,
            and nobody can learn what they do.
    """

    smooth: int
    drawn: int
    values: tuple[int, ...] = ()


class Particles(NamedTuple):
    """Points of the space, each an episode.

    Attributes:
        smooth: Standard normal numbers.
        drawn: Uniform numbers, 0 to 1.
    """

    smooth: Float64[np.ndarray, "particles smooth"]
    drawn: Float64[np.ndarray, "particles drawn"]

    def take(self, which: Int[np.ndarray, "chosen"]) -> "Particles":
        """Returns some of them."""
        return Particles(self.smooth[which], self.drawn[which])

    def where(self, first: Bool[np.ndarray, "particles"], other: "Particles") -> "Particles":
        """Returns each of these where ``first`` says so, else the other's."""
        pick = first[:, None]
        return Particles(np.where(pick, self.smooth, other.smooth), np.where(pick, self.drawn, other.drawn))


def plain_particles(space: Space, count: int, seed: int, key: tuple[int, ...]) -> Particles:
    """Returns plain draws."""
    from scipy.special import ndtri  # noqa: PLC0415 - it takes long to load

    drawn = uniforms(seed, (*key, 0), count, space.smooth + space.drawn)
    return Particles(ndtri(drawn[:, : space.smooth]), drawn[:, space.smooth :])


def uniforms(seed: int, key: tuple[int, ...], rows: int, columns: int) -> Float64[np.ndarray, "rows columns"]:
    """Returns numbers between 0 and 1, neither of which they are; each key has its own."""
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))
    return generator.random((rows, columns)) * (1.0 - 2.0**-52) + 2.0**-53


def side_by_side(parts: list[Particles]) -> Particles:
    """Returns the particles of all parts, one part after the other."""
    return Particles(np.concatenate([each.smooth for each in parts]), np.concatenate([each.drawn for each in parts]))
