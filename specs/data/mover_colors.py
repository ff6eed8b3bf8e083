"""The colours of what moves in drawings, films, logs and rendered pictures of an episode."""

from typing import NamedTuple

from specs.data.world import Color


class Tint(NamedTuple):
    """A colour, from 0 to 255 each."""

    red: int
    green: int
    blue: int

    @property
    def code(self) -> str:
        """Returns it as style sheets have it."""
        return f"#{self.red:02x}{self.green:02x}{self.blue:02x}"

    @property
    def shares(self) -> Color:
        """Returns it from 0 to 1 each, to the hundredth."""
        red, green, blue = (round(each / 255, 2) for each in self)
        return red, green, blue


ROBOT, NOSE = Tint(249, 171, 0), Tint(32, 33, 36)
PERSON, OTHER, BOX = Tint(161, 66, 244), Tint(0, 131, 143), Tint(141, 110, 63)
