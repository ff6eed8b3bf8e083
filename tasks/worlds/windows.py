"""Windows in outer walls."""

from dataclasses import dataclass, replace
from typing import Literal


@dataclass(frozen=True)
class Pane:
    """A window as geometry: its room by index, its middle on the wall's centre line, and the axis of its wall."""

    room: int
    center: tuple[float, float]
    width: float
    along: Literal["x", "y"]
    bottom: float
    top: float

    def shifted(self, dx_m: float, dy_m: float) -> "Pane":
        """Returns the window moved, in whole millimetres."""
        return replace(self, center=(round(self.center[0] + dx_m, 3), round(self.center[1] + dy_m, 3)))
