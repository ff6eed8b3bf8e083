"""Files of a shrunk failure: its world, a pipeline document that simulates it, and drawings of before and after."""

from collections.abc import Mapping
from pathlib import Path

import yaml
from pydantic import JsonValue

from flows.batch.shrink import ShrunkJob
from specs.data.episode import ApplicationLaunch
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.results.playback.trajectory_svg import failure_map_svg
from tasks.simulate.data.sources import DATA_PREFIX
from tasks.simulate.plan.request import entries
from tasks.storage.worlds import encode_world

_BUCKET, _PREFIX = "results", "regressions"
_Document = dict[str, JsonValue]


def write_case(found: ShrunkJob, folder: Path) -> list[Path]:
    """Returns the files of a regression case, written: ``case.yaml``, ``world.json``, ``before.svg``, ``after.svg``."""
    folder.mkdir(parents=True, exist_ok=True)
    job, small = found.job, f"{found.small_world.name} seed {found.small_request.seed}"
    bodies = {
        "case.yaml": case_document(found).encode(),
        "world.json": encode_world(found.small_world),
        "before.svg": failure_map_svg(floor_plan_svg(found.world), [(job, found.row)]).encode(),
        "after.svg": failure_map_svg(floor_plan_svg(found.small_world), [(small, found.small_row)]).encode(),
    }
    for name, body in bodies.items():
        (folder / name).write_bytes(body)
    return [folder / name for name in bodies]


def case_document(found: ShrunkJob) -> str:
    """Returns a pipeline document whose batch is the shrunk job alone, as YAML with what it is about on top.

    It names no version, so that it tries the newest one.
    """
    launch, request = found.request.robot, found.small_request
    before, after = len(found.world.furniture), len(found.small_world.furniture)
    about = [
        f"{found.job} fails: {found.reason}. Shrunk from {before} pieces of furniture to {after}, and from seed "
        f"{found.request.seed} to {request.seed}.",
        f"The failure here: {found.likeness}.",
        f"It failed with {launch.name} version {launch.version} ({launch.digest[:12]}); this tries the newest one.",
        "The world must be in the store: simyard world add world.json puts it there.",
    ]
    document: _Document = {
        "name": f"shrunk-{found.small_world.name}"[:64],
        "simulationBatch": {
            "engine": found.batch.plan.engine,
            "outputLocation": {"s3Bucket": _BUCKET, "s3Prefix": _PREFIX},
            "recordings": {"episodes": "all"},
            "audit": {"lanes": 0},  # of a single episode it says next to nothing
            "matrix": {"worlds": [request.world], "seeds": [request.seed]},
            "createSimulationJobRequests": [_entry(found)],
        },
    }
    return "".join(f"# {line}\n" for line in about) + yaml.safe_dump(document, sort_keys=False, width=100)


def _entry(found: ShrunkJob) -> _Document:
    request = found.request
    variables = {name: value for name, value in request.environment.items() if not value.startswith(DATA_PREFIX)}
    asked = entries(found.batch.record())[found.batch.layout.template_of(request.index)]
    data: _Document = {"dataSources": asked["dataSources"]} if asked.get("dataSources") else {}
    return {
        "maxJobDurationInSeconds": int(request.duration_s),
        "failureBehavior": request.failure_behavior,
        **data,
        "robotApplications": [_use(request.robot, variables)],
        "simulationApplications": [_use(request.scenario, {})],
    }


def _use(launch: ApplicationLaunch, variables: Mapping[str, str]) -> _Document:
    config: _Document = {"packageName": launch.package, "launchFile": launch.launch_file}
    if variables:
        config["environmentVariables"] = dict(variables)
    other: _Document = {"architecture": launch.architecture} if launch.architecture not in {None, "X86_64"} else {}
    return {"application": launch.name, **other, "launchConfig": config}
