"""What a batch is going to run: its job templates multiplied by worlds, seeds and parameters."""

import itertools
from collections.abc import Iterator
from typing import Literal

from specs.base import Spec
from specs.episode import ApplicationLaunch, EpisodeRequest

# More lanes than this bring no speed on a CPU, and cost memory (physics.md: flat from 256 lanes).
MOST_LANES = 256
_LANE_STEP = 16


class JobTemplate(Spec):
    """One of a batch's createSimulationJobRequests, with everything it refers to resolved.

    Attributes:
        environment: The launch configurations' variables; the robot's win over the scenario's.
        duration_s: Simulated seconds at most.
        worlds: ``<generation>/<world>``; the request's own world, or the matrix's.
    """

    robot: ApplicationLaunch
    scenario: ApplicationLaunch
    environment: dict[str, str]
    duration_s: float
    failure_behavior: Literal["Fail", "Continue"]
    worlds: tuple[str, ...]


class BatchPlan(Spec):
    """A batch, resolved: the same plan always gives the same rows.

    Attributes:
        seeds: One episode for each, world and parameter set.
        sweep: Environment variables by name, each with the values to try.
        lanes: Episodes in one compiled program.
        timeout_s: Wall seconds of work after which what is left is cancelled.
        world_digests: SHA-256 of each world's document.
        engine: The engine asked for.
    """

    templates: tuple[JobTemplate, ...]
    seeds: tuple[int, ...]
    sweep: dict[str, tuple[str, ...]]
    lanes: int
    timeout_s: float
    world_digests: dict[str, str]
    engine: str

    def digests(self) -> tuple[str, ...]:
        """Returns the digests of the application bundles that the batch runs, each once."""
        launches = (launch for template in self.templates for launch in (template.robot, template.scenario))
        return tuple(dict.fromkeys(launch.digest for launch in launches))


def episodes(plan: BatchPlan) -> Iterator[EpisodeRequest]:
    """Yields the batch's episodes in order: by request, world, parameter set, seed."""
    names = sorted(plan.sweep)
    settings = [dict(zip(names, values, strict=True)) for values in itertools.product(*(plan.sweep[n] for n in names))]
    index = 0
    for template in plan.templates:
        for world, setting, seed in itertools.product(template.worlds, settings, plan.seeds):
            yield EpisodeRequest(
                index=index,
                world=world,
                seed=seed,
                robot=template.robot,
                scenario=template.scenario,
                environment={**template.environment, **setting},
                duration_s=template.duration_s,
                failure_behavior=template.failure_behavior,
            )
            index += 1


def episode_count(plan: BatchPlan) -> int:
    """Returns how many episodes the plan has, without making them."""
    settings = 1
    for values in plan.sweep.values():
        settings *= len(values)
    return sum(len(template.worlds) for template in plan.templates) * settings * len(plan.seeds)


def lane_count(max_concurrency: int | None, episodes_in_all: int) -> int:
    """Returns how many lanes a chunk has.

    It depends on the document alone and never on the machine, so that chunks, and with them results, are the same
    everywhere. ``maxConcurrency`` bounds it, as it bounded RoboMaker's active jobs; a small batch is rounded up to a
    multiple of 16 so that it shares its compilation with others.
    """
    most = min(max_concurrency or MOST_LANES, MOST_LANES)
    rounded = -(-episodes_in_all // _LANE_STEP) * _LANE_STEP
    return max(1, min(most, rounded))
