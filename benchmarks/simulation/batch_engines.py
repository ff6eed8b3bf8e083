"""A thousand episodes in fifty worlds, from the start of a process to its end: nothing cached first, then warm.

    .venv/bin/python benchmarks/simulation/engines.py --batch

``exploring`` simulates every step of 60 s. ``delivering`` is what a user runs: the shipped courier plans and drives
deliveries in generated apartments, and lanes whose delivery is done take those of the chunks that follow.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.harness import ROOT
from benchmarks.simulation.engine_worlds import FOLDERS, bench_world, explorations
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from specs.template.body import template_body
from tasks.simulate.batch.chunk_run import chunks_ahead
from tasks.simulate.devices import prepare_devices
from tasks.simulate.plan.chunks import plan_chunks

EPISODES, WORLDS, LANES, DURATION_S = 1000, 50, 256, 60.0
OBSTACLES = 100
PHYSICS_HZ = 200
KINDS = ("exploring", "delivering")
COURIER, DELIVERY = "c" * 64, "d" * 64
_STATUS = Path("/proc/self/status")
_COMPILED = "/jax/core/compile/backend_compile_duration"


def batch_table(warm_runs: int) -> list[list[str]]:
    """Returns what each kind of batch takes, in a process of its own each time, cold once and then warm."""
    table = [["episodes", "cache", "wall s", "CPU s", "finished", "million lane-steps", "engine programs", "peak MiB"]]
    for kind in KINDS:
        with tempfile.TemporaryDirectory(prefix="simyard-bench-") as name:
            folder = Path(name)
            _write_worlds(kind, folder)
            for number in range(1 + warm_runs):
                wall_s, figures = _run_once(kind, folder)
                table.append([kind, "warm" if number else "empty", f"{wall_s:.1f}", *_cells(figures)])
    return table


def run_batch(kind: str, folder: Path) -> None:
    """Simulates a batch in this process, from worlds that lie in a folder, and leaves its figures there."""
    folders = FOLDERS if kind == "exploring" else shipped()
    worlds = {f"bench/{k}": World.model_validate_json((folder / f"{k}.json").read_bytes()) for k in range(WORLDS)}
    requests = explorations(EPISODES, WORLDS, DURATION_S) if kind == "exploring" else deliveries()
    rows: list[EpisodeResult] = []
    programs, chunks = _watched(), plan_chunks(requests, LANES)
    from tasks.simulate.chunk.chunk_pipeline import ChunkPipeline  # noqa: PLC0415 - imports JAX, after its settings
    from tasks.simulate.chunk.chunk_simulation import simulate_episodes  # noqa: PLC0415 - likewise

    pipeline = ChunkPipeline()
    for place, chunk in enumerate(chunks):
        ahead = [chunks[number] for number in chunks_ahead(range(place + 1, len(chunks)))]
        rows += simulate_episodes(
            chunk, worlds, folders, lanes=LANES, should_stop=lambda: False, pipeline=pipeline, ahead=ahead
        )
    figures = {
        "finished": sum(row.status == "Completed" for row in rows),
        "lane_steps": sum(row.simulated_s for row in rows) * PHYSICS_HZ,
        "programs": len(programs),
        "cpu_s": time.process_time(),
        "peak_mib": _peak_mib(),
    }
    (folder / "figures.json").write_text(json.dumps(figures))


def _peak_mib() -> float:
    """Returns the most memory that this process held; ``getrusage`` would count its parent's before it."""
    status = _STATUS.read_text().splitlines() if _STATUS.exists() else []
    return next((float(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM:")), float("nan"))


def _run_once(kind: str, folder: Path) -> tuple[float, Mapping[str, float]]:
    environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    start_s = time.perf_counter()
    subprocess.run(
        [sys.executable, __file__, kind, str(folder)],
        env={**environment, "SIMYARD_CACHE": str(folder / "cache")},
        check=True,
    )
    return time.perf_counter() - start_s, json.loads((folder / "figures.json").read_text())


def _cells(figures: Mapping[str, float]) -> list[str]:
    return [
        f"{figures['cpu_s']:.1f}",
        f"{figures['finished']:,}",
        f"{figures['lane_steps'] / 1e6:.1f}",
        f"{figures['programs']}",
        f"{figures['peak_mib']:,.0f}",
    ]


def _write_worlds(kind: str, folder: Path) -> None:
    for k in range(WORLDS):
        world = bench_world(k, OBSTACLES) if kind == "exploring" else apartment(k)
        (folder / f"{k}.json").write_text(world.model_dump_json())


def apartment(seed: int) -> World:
    """Returns a generated apartment."""
    from tasks.worlds.generate import generate_world  # noqa: PLC0415 - no start-up of the process that is measured

    template = template_body(json.loads((ROOT / "examples/templates/two-rooms.json").read_text()))
    return generate_world(template, seed=seed, generation="bench", floorplan_index=1, interior_index=1)


def shipped() -> dict[str, Path]:
    """Returns the folders of the shipped applications, by digest."""
    return {COURIER: ROOT / "applications" / "courier", DELIVERY: ROOT / "applications" / "delivery"}


def deliveries() -> list[EpisodeRequest]:
    """Returns a thousand deliveries of the courier, in one world after the other."""
    return [
        EpisodeRequest(
            index=k,
            world=f"bench/{k % WORLDS}",
            seed=k,
            robot=ApplicationLaunch(
                name="courier", version="1", digest=COURIER, package="courier", launch_file="go_to_goal"
            ),
            scenario=ApplicationLaunch(
                name="delivery", version="1", digest=DELIVERY, package="delivery", launch_file="rooms"
            ),
            environment={"MAX_SPEED": ("0.4", "0.6")[k % 2]},
            duration_s=DURATION_S,
        )
        for k in range(EPISODES)
    ]


def _watched() -> Sequence[str]:
    """Returns a list that grows by one for each program that steps lanes, compiled or taken from the cache."""
    prepare_devices()
    import jax  # noqa: PLC0415 - reads its settings when it is imported

    # As a process that simulates keeps them (``tasks.simulate.simulation_process``).
    from tasks.simulate.engines.program_cache import use_cache_folder  # noqa: PLC0415 - likewise

    use_cache_folder(Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "kept")

    found: list[str] = []

    def tell(event: str, duration_secs: float, **about: str | int) -> None:  # noqa: ARG001 - JAX's own form
        if event == _COMPILED and "advance" in str(about.get("fun_name")):
            found.append(event)

    jax.monitoring.register_event_duration_secs_listener(tell)
    return found


if __name__ == "__main__":
    run_batch(sys.argv[1], Path(sys.argv[2]))
