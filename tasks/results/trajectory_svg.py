"""Where failed episodes went wrong, drawn on the floor plan of their world.

The plan is any SVG whose root says how metres became page units: ``data-units-per-m``, and ``data-origin-x`` and
``data-origin-y``, the page position of (0, 0); y is up in the world and down on the page.
"""

import re
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as ET

from specs.episode import EpisodeResult
from tasks.results.success import reason

_END = "</svg>"
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_OTHER = "#5f6368"
# Apart in hue and in lightness (Okabe and Ito 2008).
_COLORS: Mapping[str, str] = {
    "collision": "#d55e00",
    "timeout": "#0072b2",
    "stuck": "#cc79a7",
    "out of bounds": "#009e73",
}


def failure_map_svg(plan: str, failures: Sequence[tuple[str, EpisodeResult]]) -> str:
    """Returns the plan with the path of every failure, a cross where it ended, and job and reason as tooltip.

    Args:
        plan: A floor plan as the export writes it.
        failures: Job ids and their results; those without a trajectory are left out.

    Raises:
        ValueError: The plan does not say its scale.
    """
    scale, x, y = _placement(plan)
    overlay = ET.Element("g", {"class": "failures", "fill": "none", "stroke-width": "2.5", "stroke-linejoin": "round"})
    for job, result in failures:
        if result.trajectory:
            points = [(x + x_m * scale, y - y_m * scale) for _, x_m, y_m, _ in result.trajectory]
            _path(overlay, f"{job}: {reason(result)}", _COLORS.get(reason(result), _OTHER), points)
    body, end, tail = plan.rpartition(_END)
    return body + ET.tostring(overlay, encoding="unicode") + end + tail


def _placement(plan: str) -> tuple[float, float, float]:
    root = ET.fromstring(plan)  # noqa: S314 - a plan that Simyard wrote
    texts = [root.get(f"data-{name}") for name in ("units-per-m", "origin-x", "origin-y")]
    values = [float(text) for text in texts if text is not None]
    if len(values) != 3:
        raise ValueError("the plan has no data-units-per-m, data-origin-x and data-origin-y; export it again")
    return values[0], values[1], values[2]


def _path(parent: ET.Element, title: str, color: str, points: Sequence[tuple[float, float]]) -> None:
    group = ET.SubElement(parent, "g", {"stroke": color})
    ET.SubElement(group, "title").text = _NOT_XML.sub("\ufffd", title)
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ET.SubElement(group, "polyline", {"points": line, "stroke-opacity": "0.75"})
    x, y = points[-1]
    ET.SubElement(group, "path", {"d": f"M{x:.1f} {y:.1f}m-6 -6l12 12m0 -12l-12 12", "stroke-width": "3"})
