"""Whole episodes of the shipped applications, on the engine that `auto` picks."""

from collections.abc import Mapping, Sequence

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import REPOSITORY, simulate_lanes

LANES = 16
APPLICATIONS = REPOSITORY / "applications"


def _launch(name: str, launch_file: str) -> ApplicationLaunch:
    digest = name.encode().hex().ljust(64, "0")[:64]
    return ApplicationLaunch(name=name, version="1", digest=digest, package=name, launch_file=launch_file)


COURIER, WANDERER = _launch("courier", "go_to_goal"), _launch("wanderer", "wander")
DELIVERY, COVERAGE = _launch("delivery", "rooms"), _launch("coverage", "floor")
_FOLDERS = {each.digest: APPLICATIONS / each.name for each in (COURIER, WANDERER, DELIVERY, COVERAGE)}


def drive(
    robot: ApplicationLaunch,
    scenario: ApplicationLaunch,
    worlds: Mapping[str, World],
    environments: Sequence[Mapping[str, str]],
    *,
    seeds: int = 1,
    duration_s: float = 60.0,
) -> list[EpisodeResult]:
    """Returns the rows of each environment, in each of them of each world, in each of them of each seed."""
    cases = [(each, world, seed) for each in environments for world in worlds for seed in range(seeds)]
    requests = [
        EpisodeRequest(
            index=index,
            world=world,
            seed=seed,
            robot=robot,
            scenario=scenario,
            environment=dict(environment),
            duration_s=duration_s,
        )
        for index, (environment, world, seed) in enumerate(cases)
    ]
    rows = [
        row
        for chunk in plan_chunks(requests, LANES)
        for row in simulate_lanes(chunk, dict(worlds), _FOLDERS, lanes=LANES, should_stop=lambda: False)
    ]
    return sorted(rows, key=lambda row: row.index)
