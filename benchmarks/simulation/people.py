"""People who walk for ten minutes: how many come into furniture, into one another, or get stuck.

    .venv/bin/python -m benchmarks.simulation.people [--apartments 200] [--count 4] [--minutes 10] [--first-seed 1]
    .venv/bin/python -m benchmarks.simulation.people --source warehouse.world --models models --count 10 --robots 3

Apartments are of the templates that world generation is measured with, one seed after the other; a building of one's
own is imported, and people walk there with many seeds. Places are looked at in each control step, by exact distances to
solids instead of the map that people walk on. Nobody is beside them, or so many shipped couriers, who drive from place
to place all the time.
"""

import argparse
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float64

from benchmarks.harness import ROOT, machine, markdown, options, show
from benchmarks.worlds.world_templates import HOMES, SAMPLES, read_template
from specs.data.episode import CONTROL_S, ApplicationLaunch, EpisodeRequest
from specs.data.people import MOST_PEOPLE, PERSON_HEIGHT_M, PERSON_RADIUS_M, People
from specs.data.world import World
from specs.pipeline.world_sections import WorldImport
from tasks.simulate.devices import prepare_devices
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.generate import generate_world
from tasks.worlds.importer.import_process import import_source

prepare_devices()

import jax  # noqa: E402 - it reads its settings when it is imported
import jax.numpy as jnp  # noqa: E402

from tasks.simulate.chunk.chunk_simulation import ready_parts  # noqa: E402
from tasks.simulate.geometry.free_floor import clearance_m, solids_of  # noqa: E402
from tasks.simulate.geometry.obstacles import obstacles  # noqa: E402
from tasks.simulate.geometry.walks import HostPeople, PeopleRefused, walks_in  # noqa: E402
from tasks.simulate.lane.walkers import PeopleInputs, PeopleState, begin_people, robot_disc, walk  # noqa: E402

FAR_M, HULL_M = 500.0, 0.2
# What numbers of 32 bits may lose of a distance.
ROUNDED_M = 1e-4
# What is lower a person steps over.
STEP_M = 0.05
# Who keeps within so far of a place for longer than so long is stuck; places are looked at so often.
STUCK_M, STUCK_S, LOOK_S = 0.3, 30.0, 0.5
LOOKS = round(LOOK_S / CONTROL_S)
MINUTE_STEPS = round(60.0 / CONTROL_S)
# Its plan is that of another sample, of which it only raises the ceiling.
TEMPLATES = tuple(name for name in (*SAMPLES, *HOMES) if name != "task-05-ceiling-height")
COURIER, ROUNDS = "a" * 64, "b" * 64
FOLDERS = {COURIER: ROOT / "applications/courier", ROUNDS: ROOT / "benchmarks/applications/endless"}
HEAD = ("where", "worlds", "people", "in furniture", "overlaps", f"stuck > {STUCK_S:g} s", "longest (s)")
ROBOTS_HEAD = ("robots", "nearest a person (m)", "driven each (m)", "goals each")


class Scene(NamedTuple):
    """The people of an episode, and where."""

    name: str
    seed: int
    world: World
    people: HostPeople


class Walked(NamedTuple):
    """What became of the people of an episode.

    Attributes:
        inside: How many came into a solid.
        overlaps: How many pairs came into one another.
        stood_s: For how long each kept near a place.
    """

    inside: int
    overlaps: int
    stood_s: Float64[np.ndarray, "people"]


def apartments(wanted: int, people: int, first_seed: int) -> tuple[list[Scene], list[str]]:
    """Returns so many apartments with their people, and which had no room for them."""
    found, refused = list[Scene](), list[str]()
    for seed in count(first_seed):
        for name in TEMPLATES:
            if len(found) == wanted:
                return found, refused
            try:
                body = read_template(name)
                world = generate_world(body, seed=seed, generation="people", floorplan_index=1, interior_index=1)
                found.append(scene(f"{name} {seed}", world, people, seed))
            except (WorldRejected, PeopleRefused) as exc:
                refused.append(f"{name} {seed}: {exc}")
    raise AssertionError("seeds never end")


def scene(name: str, world: World, people: int, seed: int) -> Scene:
    """Returns an episode's people; the robot is far away."""
    return Scene(name, seed, world, walks_in(world).people(People(count=people), seed, np.full(2, FAR_M), HULL_M))


def imported(source: Path, models: Sequence[Path]) -> World:
    """Returns the world of a building's file.

    Raises:
        SystemExit: It has faults.
    """
    answer = import_source(WorldImport(name="building", source=str(source), models=tuple(map(str, models)) or None))
    if answer.faults:
        raise SystemExit("\n".join(f"{fault.path}: {fault.value}: {fault.allowed}" for fault in answer.faults))
    return World.model_validate_json(answer.world)


def stacked(scenes: Sequence[Scene]) -> PeopleInputs:
    """Returns the people of all episodes, lanes first; beyond a smaller map nobody has room."""
    rows, columns = np.max([each.people.room_m.shape for each in scenes], axis=0)

    def padded(people: HostPeople) -> HostPeople:
        beyond = [(0, rows - people.room_m.shape[0]), (0, columns - people.room_m.shape[1])]
        return people._replace(room_m=np.pad(people.room_m, beyond, constant_values=-1.0))

    each = [padded(each.people) for each in scenes]
    return PeopleInputs(*jax.tree.map(lambda *parts: jnp.asarray(np.stack(parts)), *each))


@jax.jit
def minute(people: PeopleInputs, before: PeopleState) -> tuple[PeopleState, Float[jax.Array, "steps lanes people 2"]]:
    """Returns the people a minute later, and their places in all its steps."""
    robot = robot_disc(jnp.full(2, FAR_M), jnp.zeros(2), HULL_M)

    def step(state: PeopleState, _: None) -> tuple[PeopleState, jax.Array]:
        after = jax.vmap(lambda own, each: walk(own, each, [robot]))(people, state)
        return after, after.place_m

    return jax.lax.scan(step, before, None, length=MINUTE_STEPS)


def ways(scenes: Sequence[Scene], minutes: int) -> Float[np.ndarray, "lanes steps people 2"]:
    """Returns where people are in each step."""
    people = stacked(scenes)
    state, parts = jax.vmap(begin_people)(people), list[np.ndarray]()
    for _ in range(minutes):
        state, places = minute(people, state)
        parts.append(np.asarray(places))
    return np.moveaxis(np.concatenate(parts), 0, 1)[:, :, : int(np.count_nonzero(scenes[0].people.there))]


class Beside(NamedTuple):
    """What robots did beside people.

    Attributes:
        nearest_m: From a hull to a person, below 0 where they pressed against each other.
        driven_m: How far each robot went.
        goals: How many places it came to.
    """

    nearest_m: float
    driven_m: Float64[np.ndarray, "robots"]
    goals: np.ndarray


def launched(name: str, digest: str, file: str) -> ApplicationLaunch:
    """Returns an application of this repository that starts a file of its package."""
    return ApplicationLaunch(name=name, version="1", digest=digest, package=name, launch_file=file)


def ways_beside_robots(
    scenes: Sequence[Scene], count: int, robots: int, minutes: int
) -> tuple[list[Scene], list[Float[np.ndarray, "steps people 2"]], Beside]:
    """Returns the scenes in which there is room for robots as well, where people are in each step, and what robots did.

    Args:
        scenes: All of one building.
        count: How many people.
        robots: How many robots.
        minutes: For how long.

    Raises:
        SystemExit: There is none in any.
    """
    requests = [
        EpisodeRequest(
            index=number * robots + each,
            world="building",
            seed=scene.seed,
            robot=launched("courier", COURIER, "go_to_goal"),
            scenario=launched("endless", ROUNDS, "rounds"),
            environment={},
            duration_s=60.0 * minutes,
            people=People(count=count),
            robots=robots if robots > 1 else None,
            number=each,
        )
        for number, scene in enumerate(scenes)
        for each in range(robots)
    ]
    (part,) = ready_parts(requests, {"building": scenes[0].world}, FOLDERS, lanes=len(requests), engine="planar")
    for why in sorted({row.failure_reason for row in part.rows}):
        print(f"no room: {why}")
    if part.run is None:
        raise SystemExit("no room in any episode")
    state, poses, people = part.run.begin(), list[np.ndarray](), list[np.ndarray]()
    while not np.asarray(state.done).all():
        state, record = part.run.advance(state)
        poses.append(np.asarray(record.pose))
        people.append(np.asarray(record.people_m))
    pose, own = np.concatenate(poses, axis=1), np.concatenate(people, axis=1)
    steps, lanes = minutes * MINUTE_STEPS, range(len(part.lanes))
    pose, own = pose[: len(lanes), :steps], own[: len(lanes), :steps, :count]
    away_m = [np.linalg.norm(own[lane] - pose[lane, :, None, :2], axis=-1).min() for lane in lanes]
    beside = Beside(
        float(min(away_m)) - part.program.hull.radius_m - PERSON_RADIUS_M,
        np.linalg.norm(np.diff(pose[..., :2], axis=1), axis=-1).sum(axis=1).astype(np.float64),
        np.asarray(state.goal_index)[: len(lanes)],
    )
    driven = [scenes[lane.request.index // robots] for lane in part.lanes[::robots]]
    return driven, [own[lane] for lane in lanes[::robots]], beside


def judged(scene: Scene, places_m: Float[np.ndarray, "steps people 2"]) -> Walked:
    """Returns what became of an episode's people."""
    solids = solids_of(obstacles(scene.world, STEP_M, PERSON_HEIGHT_M))
    steps, people, _ = places_m.shape
    room_m = clearance_m(solids, places_m.reshape(-1, 2).astype(np.float64)).reshape(steps, people)
    inside = np.count_nonzero(room_m.min(axis=0) < PERSON_RADIUS_M - ROUNDED_M)
    pairs = [(one, other) for one in range(people) for other in range(one)]
    nearest = [np.hypot(*(places_m[:, one] - places_m[:, other]).T).min() for one, other in pairs]
    overlaps = np.count_nonzero(np.asarray(nearest) < 2 * PERSON_RADIUS_M - ROUNDED_M)
    return Walked(int(inside), int(overlaps), longest_s(places_m[::LOOKS]))


def longest_s(looks_m: Float[np.ndarray, "looks people 2"]) -> Float64[np.ndarray, "people"]:
    """Returns the longest time for which each kept near where it was when it began."""
    total, people, _ = looks_m.shape
    near = np.ones((total, people), np.bool_)
    longest = np.zeros(people, np.int64)
    for later in range(1, total):
        gone = np.linalg.norm(looks_m[later:] - looks_m[:-later], axis=-1)
        near = near[: total - later] & (gone <= STUCK_M)
        longest[near.any(axis=0)] = later
        if not near.any():
            break
    return longest * LOOK_S


def row(where: str, scenes: Sequence[Scene], found: Sequence[Walked]) -> list[str]:
    """Returns the counts of many episodes as a line of the table."""
    stood_s = np.concatenate([each.stood_s for each in found])
    counts = (
        len({id(each.world) for each in scenes}),
        len(stood_s),
        sum(each.inside for each in found),
        sum(each.overlaps for each in found),
        int(np.count_nonzero(stood_s > STUCK_S)),
    )
    return [where, *map(str, counts), f"{stood_s.max():.1f}"]


def parsed() -> Any:  # noqa: ANN401 - argparse's
    """Returns the options."""
    parser: argparse.ArgumentParser = options(__doc__)
    parser.add_argument("--apartments", type=int, default=200, help="how many; of an import, how many episodes")
    parser.add_argument("--count", type=int, default=4, help=f"people in each, at most {MOST_PEOPLE}")
    parser.add_argument("--minutes", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--robots", type=int, default=0, help="couriers that drive beside them, in an import alone")
    parser.add_argument("--source", type=Path, help="a building to import in place of apartments")
    parser.add_argument("--models", type=Path, action="append", default=[], help="folders of its models")
    return parser.parse_args()


def main() -> None:
    """Prints the counts, and who stood too long."""
    asked = parsed()
    if asked.source is None:
        where = "apartments"
        scenes, refused = apartments(asked.apartments, asked.count, asked.first_seed)
        for each in refused:
            print(f"no room: {each}")
    else:
        where, world = asked.source.stem, imported(asked.source, asked.models)
        seeds = range(asked.first_seed, asked.first_seed + asked.apartments)
        scenes = [scene(f"{where} {seed}", world, asked.count, seed) for seed in seeds]
    head, last = HEAD, list[str]()
    if asked.robots and asked.source is not None:
        scenes, walked_m, beside = ways_beside_robots(scenes, asked.count, asked.robots, asked.minutes)
        each_did = (f"{beside.nearest_m:.3f}", f"{beside.driven_m.mean():.0f}", f"{beside.goals.mean():.1f}")
        head, last = (*HEAD, *ROBOTS_HEAD), [str(len(beside.driven_m)), *each_did]
    else:
        walked_m = ways(scenes, asked.minutes)
    found = [judged(each, way) for each, way in zip(scenes, walked_m, strict=True)]
    for each, walked in zip(scenes, found, strict=True):
        if walked.inside or walked.overlaps or walked.stood_s.max() > STUCK_S:
            stood = ", ".join(f"{stood_s:g}" for stood_s in walked.stood_s)
            print(f"{each.name}: {walked.inside} in furniture, {walked.overlaps} overlaps, stood {stood} s")
    table = markdown([head, [*row(where, scenes, found), *last]])
    title = f"{asked.minutes} minutes each, seeds {scenes[0].seed} to {scenes[-1].seed}"
    show("people", f"{title}; {machine()}\n\n{table}", asked.document)


if __name__ == "__main__":
    main()
