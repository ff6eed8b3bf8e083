"""Boxes that are put into the way of a robot during an episode: how large, where, and from when until when."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from specs.base import Spec
from specs.field_types import Number
from specs.robomaker.simulation import MAX_JOB_DURATION_S
from specs.rules import Finding, items, part

MOST_BOXES = 4
LEAST_SIDE_M, MOST_SIDE_M = 0.05, 3.0

Side = Annotated[Number, Field(ge=LEAST_SIDE_M, le=MOST_SIDE_M)]


class Box(Spec):
    """A box that stands on the floor for some of an episode."""

    size_m: tuple[Side, Side, Side] = Field(
        title="Size (m)", description="How long it is along x, along y, and how high, 0.05 to 3 m each."
    )
    at_m: tuple[Number, Number] | None = Field(
        default=None,
        title="At (m)",
        description="Where its middle is (x, y); somewhere on the robot's way, if left out.",
    )
    appears_s: Annotated[Number, Field(ge=0.0, le=MAX_JOB_DURATION_S)] = Field(
        default=0.0, title="Appears (s)", description="From when on it stands there, in simulated time."
    )
    leaves_s: Annotated[Number, Field(gt=0.0, le=MAX_JOB_DURATION_S)] | None = Field(
        default=None, title="Leaves (s)", description="When it is gone again; it stays, if left out."
    )


def never_there(boxes: object) -> Iterator[Finding]:
    """Yields the boxes of a raw section that leave before they appear."""
    for number, box in enumerate(items(boxes)):
        appears_s, leaves_s = part(box, "appears_s") or 0.0, part(box, "leaves_s")
        if isinstance(appears_s, (int, float)) and isinstance(leaves_s, (int, float)) and leaves_s <= appears_s:
            yield Finding(("boxes", number, "leaves_s"), leaves_s, f"later than it appears, at {appears_s} s")
