"""Draws on the floor plan of a world: an episode as an animation, or the paths of failed episodes.

A plan is any SVG whose root says how metres became page units: ``data-units-per-m``, and ``data-origin-x`` and
``data-origin-y``, the page position of (0, 0); y is up in the world and down on the page.

An animation moves by SMIL (SVG 1.1, chapter 19), which needs no script and no network. Whoever asks for less motion is
shown the whole way and how it ended instead.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from specs.data.episode import EpisodeResult, reason
from specs.data.mover_colors import BOX, OTHER, PERSON
from specs.data.outcomes import mark_of
from specs.data.people import PERSON_RADIUS_M
from specs.data.world import Rectangle
from tasks.results.playback.playback import Playback
from tasks.results.playback.robot_view import RobotView, picture_url, robot_views

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


_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def failure_map_svg(plan: str, failures: Sequence[tuple[str, EpisodeResult]]) -> str:
    """Returns the plan with the path of every failure, a cross where it ended, and job and reason as tooltip.

    Args:
        plan: A floor plan as the export writes it.
        failures: Job ids and their results; those without a trajectory are left out.

    Raises:
        ValueError: The plan does not say its scale.
    """
    page = plan_page(plan)
    overlay = ET.Element("g", {"class": "failures", "fill": "none", "stroke-width": "2.5", "stroke-linejoin": "round"})
    for job, result in failures:
        if result.trajectory:
            points = [page.at((x_m, y_m)) for _, x_m, y_m, _ in result.trajectory]
            _path(overlay, f"{job}: {reason(result)}", mark_of(reason(result)).plan, points)
    return draw_over(plan, overlay)


def _path(parent: ET.Element, title: str, color: str, points: Sequence[tuple[float, float]]) -> None:
    group = ET.SubElement(parent, "g", {"stroke": color})
    ET.SubElement(group, "title").text = _NOT_XML.sub("\ufffd", title)
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ET.SubElement(group, "polyline", {"points": line, "stroke-opacity": "0.75"})
    x, y = points[-1]
    ET.SubElement(group, "path", {"d": f"M{x:.1f} {y:.1f}m-6 -6l12 12m0 -12l-12 12", "stroke-width": "3"})


_REST_S = 1.5
_LONGEST_S = 30.0
_MOST_FRAMES = 600
_MOST_RAYS = 72
_MOST_TIMES = 120
_BESIDE_M = 0.06
_GOAL_M = 0.1
# What a camera saw, beside the plan: how wide, from where on, how many pictures, of how many pixels a side.
_VIEW, _VIEW_TOP, _VIEW_EDGE, _MOST_PICTURES, _PICTURE_PX = 360.0, 64.0, 24.0, 120, 160
_MOVERS = "".join(
    f".replay .{name}{{fill:{tint.code};fill-opacity:{opacity};stroke:#202124;stroke-width:1}}\n"
    for name, tint, opacity in (("person", PERSON, ".75"), ("other", OTHER, ".75"), ("box", BOX, ".85"))
)
_STYLE = (
    """
.replay .way{fill:none;stroke:#b06000;stroke-width:2;stroke-opacity:.35}
.replay .driven{fill:none;stroke:#b06000;stroke-width:3;stroke-linecap:round;stroke-linejoin:round}
.replay .scan{fill:#1769d2;fill-opacity:.14;stroke:#1769d2;stroke-opacity:.5;stroke-width:.8}
.replay .robot circle{fill:#f9ab00;stroke:#202124;stroke-width:1.4}
.replay .robot polygon{fill-opacity:.8;stroke:#202124;stroke-width:1}
.replay .robot .edges polygon{fill:none;stroke-opacity:.6}
.replay .robot path{fill:none;stroke:#202124;stroke-width:2.2;stroke-linecap:round;stroke-linejoin:round}
"""
    + _MOVERS
    + """.replay .goal{fill:#188038;fill-opacity:.12;stroke:#188038;stroke-width:1.6;stroke-dasharray:4 3}
.replay .reached{fill:#188038;fill-opacity:.45;stroke:none}
.replay .goal-name{fill:#0d652d;font-size:12px;font-weight:600;text-anchor:middle}
.replay .touch{fill:none;stroke:#c5221f;stroke-width:2.4}
.replay .clock{font-size:15px;font-weight:600;text-anchor:end;font-variant-numeric:tabular-nums}
.replay .told{font-size:12px;text-anchor:end;fill:#5f6870}
.replay .bar{fill:#dadce0}.replay .past{fill:#b06000}
.replay .seen{image-rendering:pixelated}.replay .seen-by{font-size:13px}
.replay .still{display:none}
@media (prefers-reduced-motion:reduce){.replay .moving{display:none}.replay .still{display:inline}}
@media print{.replay .moving{display:none}.replay .still{display:inline}}
"""
)


def replay_svg(plan: str, playback: Playback, area: Rectangle) -> str:
    """Returns the plan with the episode playing on it, over and over, in real time or faster.

    Args:
        plan: A floor plan as the export draws it.
        playback: The episode.
        area: Where the world is: scans that see nothing end at its edge.

    Raises:
        ValueError: The plan does not say its scale.
    """
    return _Film(plan_page(plan), playback, area).drawn(plan)


class _Film:
    """A playback on a page: which samples are shown, and when."""

    def __init__(self, page: PlanPage, playback: Playback, area: Rectangle) -> None:
        self._page, self._playback, self._area = page, playback, area
        self._shown = playback.every(-(-len(playback.t_s) // _MOST_FRAMES))
        self._speed = max(1, -(-int(playback.duration_s) // int(_LONGEST_S)))
        self._length_s = playback.duration_s / self._speed + _REST_S

    def drawn(self, plan: str) -> str:
        root = ET.Element("g", {"class": "replay"})
        ET.SubElement(root, "title").text = f"Replay of {self._playback.job}: {self._playback.ending}"
        ET.SubElement(root, "style").text = _STYLE
        self._goals(root)
        ET.SubElement(root, "polyline", {"class": "way", "points": self._points()})
        moving, still = (ET.SubElement(root, "g", {"class": name}) for name in ("moving", "still"))
        self._scan(moving)
        for mark, time_s in self._marks(moving):
            self._from(mark, time_s)
        list(self._marks(still))
        self._driven(moving)
        self._boxes(moving)
        self._others(moving)
        self._robot(moving)
        self._clock(moving)
        self._still(still)
        bottom = _VIEW_TOP
        for view in robot_views(self._playback):
            bottom = self._view(moving, still, view, bottom)
        return draw_over(self._widened(plan, bottom) if bottom > _VIEW_TOP else plan, root)

    def _widened(self, plan: str, bottom: float) -> str:
        """Returns the plan with room for what the robot saw to the right of it, down to there at least."""
        width, height = self._page.width, self._page.height
        before, after = (
            f'viewBox="0 0 {x:.0f} {y:.0f}" width="{x:.0f}" height="{y:.0f}"'
            for x, y in ((width, height), (width + _VIEW, max(height, bottom)))
        )
        return plan.replace(before, after, 1)

    def _view(self, moving: ET.Element, still: ET.Element, view: RobotView, y: float) -> float:
        """Adds what a camera saw: each picture until the next one, and the last one for good.

        Args:
            moving: Of the animation.
            still: Of the drawing without motion.
            view: What it saw.
            y: Where its pictures begin on the page.

        Returns:
            Where the next camera's begin.
        """
        rows, columns = view.film.pictures.shape[1:3]
        x, width = self._page.width, _VIEW - _VIEW_EDGE
        height = width * rows / columns
        shown = view.film.t_s <= self._playback.duration_s
        numbers = np.flatnonzero(shown)[:: -(-int(shown.sum()) // _MOST_PICTURES)].tolist()
        times = [float(view.film.t_s[each]) for each in numbers]
        place = {"x": f"{x:.0f}", "y": f"{y:.0f}", "width": f"{width:.0f}", "height": f"{height:.0f}"}
        for number, begin_s, end_s in zip(numbers, times, [*times[1:], None], strict=True):
            image = {"class": "seen", "href": picture_url(view, number, _PICTURE_PX), **place}
            self._from(ET.SubElement(moving, "image", image), begin_s, end_s)
            if end_s is None:
                ET.SubElement(still, "image", image)
        for parent in (moving, still):
            label = ET.SubElement(parent, "text", {"class": "seen-by", "x": f"{x:.0f}", "y": f"{y - 8:.0f}"})
            label.text = view.label
        return y + height + _VIEW_TOP

    def _goals(self, root: ET.Element) -> None:
        for number, goal in enumerate(self._playback.goals_m):
            x, y = self._page.at(goal)
            ET.SubElement(root, "circle", {"class": "goal", **self._ring(goal, self._goal_radius_m)})
            name = ET.SubElement(root, "text", {"class": "goal-name", "x": f"{x:.1f}", "y": f"{y + 4:.1f}"})
            name.text = str(number + 1)

    def _marks(self, parent: ET.Element) -> Iterator[tuple[ET.Element, float]]:
        """Adds what is there from some time on, and yields it with that time: goals that were reached, and contacts."""
        playback = self._playback
        for number, goal in enumerate(playback.goals_m):
            reached = np.flatnonzero(playback.goal_index > number)
            if len(reached):
                mark = ET.SubElement(parent, "circle", {"class": "reached", **self._ring(goal, self._goal_radius_m)})
                yield mark, float(playback.t_s[reached[0]])
        for sample in playback.touches():
            place = self._ring(playback.pose[sample, :2], playback.radius_m + _BESIDE_M)
            ring = ET.SubElement(parent, "circle", {"class": "touch", **place})
            ET.SubElement(ring, "title").text = f"contact after {playback.t_s[sample]:.2f} s"
            yield ring, float(playback.t_s[sample])

    @property
    def _goal_radius_m(self) -> float:
        return self._playback.arrived_m or _GOAL_M

    def _ring(self, at_m: Iterable[float], radius_m: float) -> dict[str, str]:
        x, y = self._page.at(at_m)
        return {"cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": f"{radius_m * self._page.units_per_m:.1f}"}

    def _driven(self, moving: ET.Element) -> None:
        way_m = np.hypot(*np.diff(self._playback.pose[self._shown, :2], axis=0).T).cumsum()
        left = 1.0 - np.concatenate([[0.0], way_m]) / max(float(way_m[-1]) if len(way_m) else 0.0, 1e-9)
        line = {"class": "driven", "points": self._points(), "pathLength": "1", "stroke-dasharray": "1 2"}
        driven = ET.SubElement(moving, "polyline", line)
        self._animated(driven, "stroke-dashoffset", [f"{each:.4f}" for each in left])

    def _scan(self, moving: ET.Element) -> None:
        playback = self._playback
        if playback.ranges_m.shape[1] < 3 or not playback.acted.any():
            return
        rays = slice(None, None, -(-playback.ranges_m.shape[1] // _MOST_RAYS))
        # Nothing was seen in the state in which it ended: the last scan stays.
        seen = np.flatnonzero(playback.acted)
        samples = [int(seen[max(0, np.searchsorted(seen, each, side="right") - 1)]) for each in self._shown]
        outlines = [_line([self._page.at(point) for point in playback.seen_m(each)[rays]]) for each in samples]
        low, high = (
            self._page.at(corner)
            for corner in ((self._area.x_min_m, self._area.y_max_m), (self._area.x_max_m, self._area.y_min_m))
        )
        edge = ET.SubElement(moving, "clipPath", {"id": "replay-area"})
        size = {"width": f"{high[0] - low[0]:.1f}", "height": f"{high[1] - low[1]:.1f}"}
        ET.SubElement(edge, "rect", {"x": f"{low[0]:.1f}", "y": f"{low[1]:.1f}", **size})
        shape = ET.SubElement(
            moving, "polygon", {"class": "scan", "points": outlines[0], "clip-path": "url(#replay-area)"}
        )
        self._animated(shape, "points", outlines, mode="discrete")

    def _others(self, moving: ET.Element) -> None:
        for kind, movers_m, radius_m in self._movers():
            for mover_m in np.moveaxis(movers_m, 1, 0):
                places = [self._page.at(place) for place in mover_m[self._shown]]
                dot = ET.SubElement(moving, "circle", {"class": kind, **self._ring(mover_m[0], radius_m)})
                for axis, name in enumerate(("cx", "cy")):
                    self._animated(dot, name, [f"{place[axis]:.1f}" for place in places])

    def _boxes(self, moving: ET.Element) -> None:
        """Adds boxes that were put there, each seen while it stands."""
        boxes = self._playback.boxes
        for number, size_m in enumerate(boxes.sizes_m if boxes else ()):
            assert boxes is not None  # noqa: S101 - it has sizes
            there = boxes.there[self._shown, number]
            if there.any():
                place_m = boxes.places_m[self._shown][int(np.argmax(there)), number]
                box = ET.SubElement(moving, "rect", self._rectangle(place_m, size_m))
                seen = ["visible" if each else "hidden" for each in there.tolist()]
                self._animated(box, "visibility", seen, mode="discrete")

    def _rectangle(self, at_m: Iterable[float], size_m: tuple[float, float, float]) -> dict[str, str]:
        x, y = self._page.at(at_m)
        wide, deep = (side * self._page.units_per_m for side in size_m[:2])
        size = {"width": f"{wide:.1f}", "height": f"{deep:.1f}"}
        return {"class": "box", "x": f"{x - wide / 2:.1f}", "y": f"{y - deep / 2:.1f}", **size}

    def _movers(self) -> Iterator[tuple[str, np.ndarray, float]]:
        """Yields people and other robots: what they are, where they are at each sample, and their radius."""
        yield "person", self._playback.people_m, PERSON_RADIUS_M
        yield "other", self._playback.robots_m, self._playback.radius_m

    def _robot(self, moving: ET.Element) -> None:
        poses = self._playback.pose[self._shown]
        places = [" ".join(f"{each:.1f}" for each in self._page.at(pose[:2])) for pose in poses]
        # Degrees that do not jump at half a turn; clockwise, since y is down on the page.
        turns = [f"{-each:.1f}" for each in np.degrees(np.unwrap(poses[:, 2].astype(np.float64)))]
        group = self._body(moving, places[0], turns[0])
        self._animated(group, "transform", places, kind="translate")
        self._animated(group[0], "transform", turns, kind="rotate")

    def _still(self, still: ET.Element) -> None:
        """Adds robots, people and boxes where they ended, and how long it took."""
        if self._playback.boxes is not None:
            for at_m, size_m in self._playback.boxes.standing(-1):
                ET.SubElement(still, "rect", self._rectangle(at_m, size_m))
        for kind, movers_m, radius_m in self._movers():
            for mover_m in movers_m[-1]:
                ET.SubElement(still, "circle", {"class": kind, **self._ring(mover_m, radius_m)})
        x, y, yaw = (float(each) for each in self._playback.pose[-1])
        place = " ".join(f"{each:.1f}" for each in self._page.at((x, y)))
        self._body(still, place, f"{-np.degrees(yaw):.1f}")
        self._text(still, "clock", 0, f"{self._playback.duration_s:.2f} s")
        self._text(still, "told", 1, self._playback.ending)

    def _body(self, parent: ET.Element, place: str, turn: str) -> ET.Element:
        group = ET.SubElement(parent, "g", {"class": "robot", "transform": f"translate({place})"})
        turned = ET.SubElement(group, "g", {"transform": f"rotate({turn})"})
        radius = self._playback.radius_m * self._page.units_per_m
        if self._playback.shape:
            self._parts(turned)
        else:
            ET.SubElement(turned, "circle", {"r": f"{radius:.1f}"})
        ET.SubElement(turned, "path", {"d": f"M0 0H{radius:.1f}m-5 -4l5 4l-5 4"})
        return group

    def _parts(self, turned: ET.Element) -> None:
        """Adds the robot's parts, the lowest first, then all of their edges: one inside another is seen as well."""
        scale = self._page.units_per_m
        edges = ET.Element("g", {"class": "edges"})
        for part in self._playback.shape:
            points = _line([(x * scale, -y * scale) for x, y in part.outline_m])
            red, green, blue = (round(255 * channel) for channel in part.color[:3])
            ET.SubElement(turned, "polygon", {"points": points, "fill": f"rgb({red},{green},{blue})"})
            ET.SubElement(edges, "polygon", {"points": points})
        turned.append(edges)

    def _clock(self, moving: ET.Element) -> None:
        """Adds a bar that fills up, and a text for each second that is shown while it lasts."""
        x, width = self._page.width - 64.0, 180.0
        box = {"x": f"{x - width:.1f}", "y": "72", "height": "5"}
        ET.SubElement(moving, "rect", {"class": "bar", "width": f"{width:.0f}", **box})
        past = ET.SubElement(moving, "rect", {"class": "past", "width": "0", **box})
        times = self._playback.t_s[self._shown] / max(self._playback.duration_s, 1e-9)
        self._animated(past, "width", [f"{width * each:.1f}" for each in times])
        length_s = self._playback.duration_s
        step_s = max(1, -(-int(length_s) // _MOST_TIMES))
        for begin_s in range(0, math.ceil(length_s), step_s):
            text = self._text(moving, "clock", 0, f"{begin_s} s")
            self._from(text, begin_s, min(begin_s + step_s, length_s))
        self._from(self._text(moving, "clock", 0, f"{length_s:.2f} s"), length_s)
        fast = f", {self._speed} times as fast" if self._speed > 1 else ""
        self._text(moving, "told", 1, f"{self._playback.ending}{fast}")

    def _text(self, parent: ET.Element, name: str, line: int, text: str) -> ET.Element:
        place = {"x": f"{self._page.width - 64.0:.1f}", "y": f"{48 + 17 * line}"}
        found = ET.SubElement(parent, "text", {"class": name, **place})
        found.text = text
        return found

    def _points(self) -> str:
        return _line([self._page.at(pose[:2]) for pose in self._playback.pose[self._shown]])

    def _from(self, parent: ET.Element, begin_s: float, end_s: float | None = None) -> None:
        """Hides an element until some time, and after another one."""
        marks = [(0.0, "hidden")] if begin_s > 0.0 else []
        marks.append((self._share(begin_s), "visible"))
        marks += [] if end_s is None else [(self._share(end_s), "hidden")]
        settings = {"attributeName": "visibility", "calcMode": "discrete"}
        self._keyed(parent, settings, [value for _, value in marks], [share for share, _ in marks])

    def _animated(
        self, parent: ET.Element, name: str, values: Sequence[str], *, kind: str = "", mode: str = "linear"
    ) -> None:
        """Adds an animation over the samples that are shown, and the rest at the end."""
        shares = [self._share(float(each)) for each in self._playback.t_s[self._shown]]
        settings = {"attributeName": name, "calcMode": mode, **({"type": kind} if kind else {})}
        self._keyed(parent, settings, [*values, values[-1]], [*shares, 1.0])

    def _keyed(
        self, parent: ET.Element, settings: Mapping[str, str], values: Sequence[str], shares: Sequence[float]
    ) -> None:
        times = ";".join(f"{share:.5f}".rstrip("0").rstrip(".") for share in shares)
        every = {"dur": f"{self._length_s:.3f}s", "repeatCount": "indefinite"}
        name = "animateTransform" if "type" in settings else "animate"
        ET.SubElement(parent, name, {**settings, **every, "values": ";".join(values), "keyTimes": times})

    def _share(self, time_s: float) -> float:
        return min(time_s / self._speed / self._length_s, 1.0)


def _line(points: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
