"""The plan of a batch: job templates to be multiplied by worlds, seeds and parameters."""

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from specs.base import Spec
from specs.data.boxes import Box
from specs.data.episode import ApplicationLaunch, is_alone
from specs.data.people import People
from specs.field_types import BagFormat
from specs.pipeline.simulation_section import AUDITED_LANES, Recordings
from specs.robomaker.bundle import ApplicationKind
from specs.robomaker.simulation import FailureBehavior
from tasks.simulate.data.data_sources import PinnedSource

# A CPU gains nothing from more lanes (docs/reference/physics.md, section 4: flat from 256 on), and a chunk that is lost
# costs what it took.
DEFAULT_LANES = 256
MOST_LANES = 4096
_LANE_STEP = 16
# Batches of before say True: they were looked at with no end in sight, and are judged so.
Shuffled = Literal[False, "episodes", "pairs"]


class JobTemplate(Spec):
    """One of a batch's createSimulationJobRequests, with everything it refers to resolved.

    Attributes:
        robot: What drives; the simulation application itself, where there is no robot application.
        scenario: What judges.
        environment: The launch configurations' variables; the robot's win over the scenario's. Those of data sources
            are ``data:<digest>`` (``data_sources``), and folders only where an episode is simulated.
        judge_environment: What the simulation application's own nodes have otherwise: values of variables that both
            set; None where they agree.
        duration_s: Simulated seconds at most.
        worlds: ``<generation>/<world>`` of the request's own world; empty for the matrix's worlds.
        seed: The request's own; None for the matrix's seeds.
        record: Whether its episodes are recorded whatever comes of them.
    """

    robot: ApplicationLaunch
    scenario: ApplicationLaunch
    environment: dict[str, str]
    duration_s: float
    failure_behavior: FailureBehavior
    worlds: tuple[str, ...] = ()
    record: bool = False
    seed: int | None = None
    judge_environment: dict[str, str] | None = None

    @property
    def alone(self) -> bool:
        """Returns whether there is no robot application."""
        return is_alone(self.robot, self.scenario)

    @property
    def judge_variables(self) -> dict[str, str]:
        """Returns the environment variables of the simulation application's nodes."""
        return {**self.environment, **(self.judge_environment or {})}


class BatchPlan(Spec):
    """A batch, resolved: the same plan always gives the same rows.

    It grows with the requests, worlds, seeds and values of a document, never with their product: what is multiplied
    out is computed by ``tasks.simulate.plan.episode_layout``.

    Attributes:
        worlds: ``<generation>/<world>`` of each world of the matrix.
        seeds: One episode for each, world and parameter set; one alone where a request has its own.
        sweep: Environment variables by name, each with the values to try.
        lanes: Episodes in one chunk, at most.
        timeout_s: Wall seconds of work after which what is left is cancelled.
        world_digests: SHA-256 of each world's document.
        engine: The engine asked for.
        data_sources: What episodes read from buckets, by digest.
        recordings: Which episodes are recorded besides those whose request says so, and at which rate.
        audit: Episodes that are driven again on C MuJoCo at the end; 0 for none.
        people: Who walks in each world; None for nobody.
        boxes: What is put into each world; None for nothing.
        robots: How many robots share each world, each with a row of its own; None for one.
        shuffled: What chunks take from all over the batch, so that it may be ended after any of them: episodes, or the
            same episodes for both versions in turn. False if nothing.
    """

    templates: tuple[JobTemplate, ...]
    worlds: tuple[str, ...]
    seeds: tuple[int, ...]
    sweep: dict[str, tuple[str, ...]]
    lanes: int
    timeout_s: float
    world_digests: dict[str, str]
    engine: str
    data_sources: dict[str, PinnedSource] = Field(default_factory=dict[str, PinnedSource])
    recordings: Recordings = Recordings()
    audit: int = AUDITED_LANES
    shuffled: Shuffled = False
    people: People | None = None
    boxes: tuple[Box, ...] | None = None
    robots: int | None = None

    @property
    def sharing(self) -> int:
        """Returns how many robots drive in a world together; 1 is each alone."""
        return self.robots or 1

    def digests(self) -> tuple[str, ...]:
        """Returns the digests of the application bundles that the batch runs, each once."""
        return tuple(self.bundles())

    def first_bundles(self) -> tuple[str, ...]:
        """Returns the digests of the bundles that its first request runs, in a process of their own."""
        first = self.templates[0]
        return tuple(dict.fromkeys((first.robot.digest, first.scenario.digest)))

    def bundles(self) -> dict[str, str]:
        """Returns the name of each application that the batch runs, by its bundle's digest."""
        return {launch.digest: launch.name for _, launch in self.launches()}

    def launches(self) -> Iterator[tuple[ApplicationKind, ApplicationLaunch]]:
        """Yields the applications as its requests launch them, and of which kind each is."""
        for template in self.templates:
            if not template.alone:
                yield "robot-application", template.robot
            yield "simulation-application", template.scenario

    def records(self) -> bool:
        """Returns whether any of its episodes may be recorded."""
        return self.recordings.episodes != "none" or any(template.record for template in self.templates)

    def bags_of(self, template: JobTemplate) -> tuple[BagFormat, ...]:
        """Returns the formats in which recorded episodes of a request are written for ROS's tools."""
        if self.recordings.bags is None:
            return ("rosbag",) if template.record else ()
        return self.recordings.bags

    def makes_bags(self) -> bool:
        """Returns whether any recorded episode is written for ROS's tools."""
        return self.records() and any(map(self.bags_of, self.templates))

    def worlds_of(self, template: JobTemplate) -> tuple[str, ...]:
        """Returns the worlds that a request is multiplied by."""
        return template.worlds or self.worlds

    def seeds_of(self, template: JobTemplate) -> tuple[int, ...]:
        """Returns the seeds that a request is multiplied by: as many as the matrix has."""
        return self.seeds if template.seed is None else (template.seed,)

    def seeds_used(self) -> tuple[int, ...]:
        """Returns the seed of each episode, each once, in order."""
        own = [template.seed for template in self.templates if template.seed is not None]
        return tuple(dict.fromkeys([*(self.seeds if len(own) < len(self.templates) else ()), *own]))

    def worlds_used(self) -> dict[str, str]:
        """Returns the SHA-256 of each world that an episode runs in, by ``<generation>/<world>``.

        Raises:
            KeyError: The digest of one is not known.
        """
        used = dict.fromkeys(world for template in self.templates for world in self.worlds_of(template))
        return {world: self.world_digests[world] for world in used}

    def variables(self) -> dict[str, tuple[str | None, ...]]:
        """Returns the values that each environment variable takes, in order; None where an episode does not set it."""
        names = sorted({name for template in self.templates for name in template.environment} | self.sweep.keys())
        return {name: self.sweep.get(name) or self._own_values(name) for name in names}

    def _own_values(self, name: str) -> tuple[str | None, ...]:
        return tuple(dict.fromkeys(template.environment.get(name) for template in self.templates))


def lane_count(max_concurrency: int | None, episodes_in_all: int, robots: int = 1) -> int:
    """Returns how many lanes a chunk has.

    It depends on the document alone and never on the machine, so that chunks, and with them results, are the same
    everywhere; a machine that has too little memory for so many runs a chunk in parts
    (`tasks.simulate.sandbox.sandbox_client`).
    ``maxConcurrency`` is the number, as it was the number of RoboMaker's active jobs; a small batch is rounded up to a
    multiple of 16 so that it shares its compilation with others. Robots that share a world are in one chunk.
    """
    most = min(max_concurrency or DEFAULT_LANES, MOST_LANES)
    rounded = -(-episodes_in_all // _LANE_STEP) * _LANE_STEP
    return whole_groups(max(1, min(most, rounded)), robots)


def whole_groups(lanes: int, robots: int) -> int:
    """Returns how many of so many lanes robots fill that share worlds; those of one world at least."""
    return max(robots, lanes - lanes % robots)
