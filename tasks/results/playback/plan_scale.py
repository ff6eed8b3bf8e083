"""Reads the scale of a floor plan, and draws over one.

A plan is any SVG whose root says how metres became page units: ``data-units-per-m``, and ``data-origin-x`` and
``data-origin-y``, the page position of (0, 0); y is up in the world and down on the page.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree as ET

_END = "</svg>"


@dataclass(frozen=True)
class PlanPage:
    """The scale of a plan, and where its origin is."""

    units_per_m: float
    x: float
    y: float
    width: float
    height: float

    def at(self, point_m: Iterable[float]) -> tuple[float, float]:
        """Returns the page position of a point."""
        x_m, y_m = point_m
        return self.x + x_m * self.units_per_m, self.y - y_m * self.units_per_m


def plan_page(plan: str) -> PlanPage:
    """Returns where a plan has which metre.

    Raises:
        ValueError: The plan does not say its scale.
    """
    root = ET.fromstring(plan)  # noqa: S314 - a plan that Simyard wrote
    texts = [root.get(f"data-{name}") for name in ("units-per-m", "origin-x", "origin-y")]
    values = [float(text) for text in texts if text is not None]
    if len(values) != 3:
        raise ValueError("the plan has no data-units-per-m, data-origin-x and data-origin-y; export it again")
    units_per_m, x, y = values
    width, height = map(float, (root.get("viewBox") or "0 0 0 0").split()[2:])
    return PlanPage(units_per_m, x, y, width, height)


def draw_over(plan: str, overlay: ET.Element) -> str:
    """Returns a plan with something drawn on top of it."""
    body, end, tail = plan.rpartition(_END)
    return body + ET.tostring(overlay, encoding="unicode") + end + tail
