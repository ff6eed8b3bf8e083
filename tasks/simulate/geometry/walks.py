"""Where people walk in a world: places beside its furniture and in its rooms, and the shortest ways between them.

A person is an upright cylinder that is higher than a robot, and so fits into fewer places than one.
"""

import functools
import itertools
from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M, People
from specs.data.world import FloorZone, Room, World
from tasks.simulate.application.contract import HostMap
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.shortest_path import Ways, shortest_lines
from tasks.simulate.geometry.world_arrays import floor_map

# What is lower a person steps over.
_STEP_M = 0.05
# Room beside a person on its way, and so many places, of which the farthest from one another are taken.
_SPARE_M = 0.05
_MOST_PLACES = 16
# From a piece of furniture to the place beside it.
_BESIDE_M = 1.0
# A person walks a round of so many corners, again and again: one program serves all.
CORNERS = 48
_ROUNDS, _LEAST = 8, 4
_STAYS_S = (2.0, 10.0)
_PATIENCE_S = (2.0, 6.0)
_PACES = (0.8, 1.2)
_LEAN_RAD = 0.05
# How near to one another people begin, and to the robot, between the surfaces of both.
_APART_M, _FROM_ROBOT_M = 0.1, 1.0
_DRAWS = 64
# The stream of a seed's noise that people are drawn from; each has a counter of its own.
_STREAM = 0x70656F706C65
_KEPT = 64
# Of a recording; more by powers of two.
_LEAST_KNOTS = 8


Arrays = Any  # of NumPy on the host, of JAX in a program


class PeopleRefused(ValueError):  # noqa: N818 - an episode
    """An episode cannot have the people that it asks for."""


class Recording(NamedTuple):
    """How people walked, which they do again; arrays of the host or of a device.

    Attributes:
        at_s: When each was at each of its places; never at those that fill up.
        places_m: The places (x, y).
        period_s: After so long each begins anew; infinite for one that stays.
    """

    at_s: Float[Arrays, "people knots"]
    places_m: Float[Arrays, "people knots 2"]
    period_s: Float[Arrays, "people"]


class HostPeople(NamedTuple):
    """The people of an episode, before they go to a device; people first, those beyond the count not there.

    Attributes:
        there: Which there are.
        aware: Which see the robot.
        speed_m_s: How fast each likes to walk.
        lean_rad: How far to the left of its way each likes to walk, so that no two who meet mirror each other.
        patience_s: How long each waits for others to clear its way before it turns back.
        corners_m: Of its round.
        corner_count: How many it has.
        stay_s: How long it stays at each corner; 0 where its way only bends.
        toward: The corner that it walks to at first.
        place_m: Where it begins.
        room_m: A map of how much room a person has left around it where it stands, rows first; below 0 in none.
        low_m: Where the map's first point is.
        cell_m: From one point to the next.
        recording: How they walked; None of people who walk by ORCA.
    """

    there: np.ndarray
    aware: np.ndarray
    speed_m_s: Float32[np.ndarray, "people"]
    lean_rad: Float32[np.ndarray, "people"]
    patience_s: Float32[np.ndarray, "people"]
    corners_m: Float32[np.ndarray, "people corners 2"]
    corner_count: Int[np.ndarray, "people"]
    stay_s: Float32[np.ndarray, "people corners"]
    toward: Int[np.ndarray, "people"]
    place_m: Float32[np.ndarray, "people 2"]
    room_m: Float32[np.ndarray, "rows columns"]
    low_m: Float32[np.ndarray, "2"]
    cell_m: Float32[np.ndarray, ""]
    recording: Recording | None = None


class _Round(NamedTuple):
    """A closed way: its corners, and which of them are places."""

    corners_m: Float64[np.ndarray, "corners 2"]
    is_place: np.ndarray


class Walks:
    """Where people walk in a world; found when it is asked for first."""

    def __init__(self, world: World) -> None:
        """Begins with nothing found.

        Args:
            world: The world.
        """
        self._world = world

    @functools.cached_property
    def room(self) -> HostMap:
        """How far each point of the floor is from the nearest solid that a person cannot step over."""
        return floor_map(self._world, obstacles(self._world, _STEP_M, PERSON_HEIGHT_M))

    @functools.cached_property
    def legs(self) -> dict[tuple[int, int], Float64[np.ndarray, "corners 2"]]:
        """The shortest ways between places that all lead to one another, by both numbers."""
        touched = obstacles(self._world, _STEP_M, PERSON_HEIGHT_M)
        ways, places = Ways(touched, PERSON_RADIUS_M + self._guard_m + _SPARE_M), self._places()
        pairs = list(itertools.permutations(range(len(places)), 2))
        if not pairs:
            return {}
        (lines,) = shortest_lines(ways.graph, places[np.array(pairs)])
        found = {pair: line[:count] for pair, line, count in zip(pairs, *lines, strict=True) if count > 0}
        most = max(range(len(places)), key=lambda one: sum((one, other) in found for other in range(len(places))))
        together = {most, *(other for one, other in found if one == most)}
        return {pair: line for pair, line in found.items() if set(pair) <= together}

    @property
    def _guard_m(self) -> float:
        """How much the map may say too much between its points, where a person just fits.

        By a corner the distance bends as a circle does, by one in its own length; so the plane through a square's
        points is above it by an eighth of the square times that.
        """
        cell_m = float(self.room.cell_m)
        return cell_m**2 / 8.0 / max(PERSON_RADIUS_M - 0.5 * cell_m, _STEP_M)

    @functools.cached_property
    def _left_m(self) -> Float32[np.ndarray, "rows columns"]:
        return (self.room.clearance_m - np.float32(PERSON_RADIUS_M + self._guard_m)).astype(np.float32)

    def _places(self) -> Float64[np.ndarray, "places 2"]:
        """Returns places where a person stands: in front of furniture, in the middle of rooms, or anywhere."""
        room, world = self.room, self._world
        row, column = np.nonzero(self._left_m >= 1.5 * _SPARE_M)
        points = room.origin_m.astype(np.float64) + float(room.cell_m) * np.stack([column, row], axis=1)
        if not len(points):
            return points
        wanted = [*(piece.center_m for piece in world.furniture), *map(_middle, world.areas)]
        to_points = [np.hypot(*(points - middle).T) for middle in wanted]
        beside = [int(np.argmin(away)) for away in to_points if away.min() <= _BESIDE_M]
        chosen = points[sorted(set(beside))] if len(set(beside)) > 1 else points
        return _scattered(chosen, _MOST_PLACES)

    def people(
        self, asked: People, seed: int, robots_m: Float64[np.ndarray, "*robots 2"], robot_radius_m: float
    ) -> HostPeople:
        """Returns the people of an episode, each drawn from its seed, whoever is beside it.

        Args:
            asked: How many, and how they are.
            seed: The episode's.
            robots_m: Where its robot begins, or its robots.
            robot_radius_m: Of the hull.

        Raises:
            PeopleRefused: The world has not enough places to walk between, or not enough room for all to begin.
        """
        if asked.model == "recorded":
            return _recorded(self._world, asked, robots_m, robot_radius_m)
        if not self.legs:
            raise PeopleRefused(f"people: {asked.count}: {self._world.name} has no two places that a person fits in")
        lone = _nobody(_places_for(asked.count), self.room._replace(clearance_m=self._left_m))
        begun: list[Float64[np.ndarray, 2]] = []
        for number in range(asked.count):
            rng = np.random.Generator(np.random.Philox(key=[seed % (1 << 64), _STREAM], counter=[0, 0, 0, number]))
            way = self._round(rng)
            count = len(way.corners_m)
            lone.there[number] = True
            lone.aware[number] = rng.random() >= asked.unaware
            lone.speed_m_s[number] = asked.speed_ms * rng.uniform(*_PACES)
            lone.lean_rad[number] = rng.uniform(-_LEAN_RAD, _LEAN_RAD)
            lone.patience_s[number] = rng.uniform(*_PATIENCE_S)
            lone.corners_m[number, :count] = way.corners_m
            lone.corner_count[number] = count
            lone.stay_s[number, :count] = np.where(way.is_place, rng.uniform(*_STAYS_S, count), 0.0)
            toward, place = _begin(way, rng, begun, robots_m, robot_radius_m)
            if place is None:
                walk = f"{self._world.name} has room for {number} people to begin in"
                raise PeopleRefused(f"people: {asked.count}: {walk}")
            lone.toward[number], lone.place_m[number] = toward, place
            begun.append(place)
        return lone

    def _round(self, rng: np.random.Generator) -> _Round:
        """Returns a round through places that are drawn one after the other, as many as its corners allow."""
        onward: dict[int, list[int]] = {}
        for one, other in self.legs:
            onward.setdefault(one, []).append(other)
        first = here = int(rng.choice(sorted(onward)))
        parts, marks = list[np.ndarray](), list[np.ndarray]()
        for _ in range(_ROUNDS):
            there = int(rng.choice(onward[here]))
            leg = self.legs[here, there]
            home = len(self.legs[there, first]) if there != first else 0
            if sum(map(len, parts)) + len(leg) + home > CORNERS:
                break
            parts.append(leg[:-1])
            marks.append(np.arange(len(leg) - 1) == 0)
            here = there
        if not parts:
            return self._short_round(rng)
        if here != first:
            leg = self.legs[here, first]
            parts.append(leg[:-1])
            marks.append(np.arange(len(leg) - 1) == 0)
        return _Round(np.concatenate(parts), np.concatenate(marks))

    def _short_round(self, rng: np.random.Generator) -> _Round:
        """Returns a round from one place to another and back: for who has drawn a first leg of too many corners.

        Raises:
            PeopleRefused: All have too many.
        """
        short = sorted(
            pair for pair, leg in self.legs.items() if len(leg) + len(self.legs[pair[1], pair[0]]) <= CORNERS
        )
        if not short:
            raise PeopleRefused(f"{self._world.name} has no way with at most {CORNERS} corners, there and back")
        one, other = short[int(rng.integers(len(short)))]
        parts = [self.legs[one, other][:-1], self.legs[other, one][:-1]]
        return _Round(np.concatenate(parts), np.concatenate([np.arange(len(part)) == 0 for part in parts]))


def _middle(area: Room | FloorZone) -> tuple[float, float]:
    """Returns the middle of the rectangle around a room, or a zone."""
    floor = area.floor
    return (floor.x_min_m + floor.x_max_m) / 2, (floor.y_min_m + floor.y_max_m) / 2


def _scattered(points: Float64[np.ndarray, "points 2"], most: int) -> Float64[np.ndarray, "places 2"]:
    """Returns so many of the points, each the farthest from those before."""
    chosen = [0]
    away = np.hypot(*(points - points[0]).T)
    while len(chosen) < min(most, len(points)) and away.max() > 2 * PERSON_RADIUS_M:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.hypot(*(points - points[chosen[-1]]).T))
    return points[chosen]


def _places_for(count: int) -> int:
    """Returns how many people a program has places for, one for few numbers of them."""
    return max(_LEAST, 1 << (count - 1).bit_length())


def _nobody(size: int, room: HostMap) -> HostPeople:
    """Returns the arrays of so many people, none of whom is there."""
    numbers, two = np.zeros(size, np.float32), np.zeros((size, 2), np.float32)
    return HostPeople(
        there=np.zeros(size, np.bool_),
        aware=np.zeros(size, np.bool_),
        speed_m_s=numbers.copy(),
        lean_rad=numbers.copy(),
        patience_s=numbers.copy(),
        corners_m=np.zeros((size, CORNERS, 2), np.float32),
        corner_count=np.ones(size, np.int32),
        stay_s=np.zeros((size, CORNERS), np.float32),
        toward=np.zeros(size, np.int32),
        place_m=two,
        room_m=room.clearance_m,
        low_m=room.origin_m,
        cell_m=room.cell_m,
    )


def _begin(
    way: _Round,
    rng: np.random.Generator,
    others: list[Float64[np.ndarray, "2"]],
    robots_m: Float64[np.ndarray, "*robots 2"],
    robot_radius_m: float,
) -> tuple[int, Float64[np.ndarray, "2"] | None]:
    """Returns the corner to walk to, and a place on the way there that is clear of others; None if none was found."""
    starts, ends = np.roll(way.corners_m, 1, axis=0), way.corners_m
    for number, share in zip(rng.integers(len(ends), size=_DRAWS).tolist(), rng.random(_DRAWS).tolist(), strict=True):
        place = starts[number] + share * (ends[number] - starts[number])
        clear = [np.hypot(*(place - other)) >= 2 * PERSON_RADIUS_M + _APART_M for other in others]
        from_robots_m = np.min(np.hypot(*(place - robots_m).T)) - robot_radius_m - PERSON_RADIUS_M
        if all(clear) and from_robots_m >= _FROM_ROBOT_M:
            return number, place
    return 0, None


def _recorded(
    world: World, asked: People, robots_m: Float64[np.ndarray, "*robots 2"], robot_radius_m: float
) -> HostPeople:
    """Returns people who do the world's first walks again; its seed draws nothing of them.

    Raises:
        PeopleRefused: It has too few, or one begins where the robot does.
    """
    walks = (world.walks or ())[: asked.count]
    if len(walks) < asked.count:
        raise PeopleRefused(f"people: {asked.count}: {world.name} has {len(walks)} recorded walks")
    size = _places_for(asked.count)
    knots = 1 << max(_LEAST_KNOTS, *(len(walk.times_s) for walk in walks)).bit_length()
    nothing = np.zeros((2, 2), np.float32)
    lone = _nobody(size, HostMap(nothing, nothing[0], np.ones((), np.float32), np.zeros(4, np.float32)))
    at_s, places_m = np.full((size, knots), np.inf, np.float32), np.zeros((size, knots, 2), np.float32)
    period_s = np.full(size, np.inf, np.float32)
    for number, walk in enumerate(walks):
        count = len(walk.times_s)
        at_s[number, :count], places_m[number, :count] = walk.times_s, walk.points_m
        places_m[number, count:] = walk.points_m[-1]
        period_s[number] = walk.period_s or np.inf
        lone.there[number], lone.place_m[number] = True, walk.points_m[0]
        if np.min(np.hypot(*(np.asarray(walk.points_m[0]) - robots_m).T)) < robot_radius_m + PERSON_RADIUS_M:
            raise PeopleRefused(f"people: {asked.count}: {walk.name} begins where the robot does")
    return lone._replace(recording=Recording(at_s, places_m, period_s))


_walks: OrderedDict[int, tuple[World, Walks]] = OrderedDict()


def walks_in(world: World) -> Walks:
    """Returns where people walk in a world; kept, since the episodes of a batch share their worlds."""
    kept = _walks.pop(id(world), None) or (world, Walks(world))
    _walks[id(world)] = kept
    while len(_walks) > _KEPT:
        _walks.popitem(last=False)
    return kept[1]
