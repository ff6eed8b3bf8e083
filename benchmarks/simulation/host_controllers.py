"""Control steps a second of controllers on the host: a network of two layers of 64, over 64 rays.

    .venv/bin/python -m benchmarks.simulation.host_controllers [--lanes N] [--turns N] [--document FILE]

The variants take turns in one process. "one by one" is plain Python that runs the network robot by robot on C MuJoCo:
what a network cost before controllers on the host ran beside every engine.
"""

import argparse
import importlib.util
import statistics
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks.machine import machine
from benchmarks.tables import markdown, with_tables
from tasks.simulate.devices import prepare_devices

prepare_devices()

import numpy as np  # noqa: E402 - JAX reads its settings when it is imported
import onnx  # noqa: E402

from specs.data.episode import ApplicationLaunch, EpisodeRequest  # noqa: E402
from tasks.simulate.chunk.chunk_simulation import ready_chunk  # noqa: E402
from tasks.simulate.engines.program import Run  # noqa: E402
from tests.factories.policies import bundle, network, weights  # noqa: E402
from tests.factories.simulations import ENDLESS, FOLDERS, cluttered  # noqa: E402

DIGEST = "9" * 64
SLICES = 8
DECLARED = """\
lidar: {rays: 64, range_m: 8.0}
inputs: [{parts: [{field: ranges_m, scale: 0.125}, {field: goal_robot_m, scale: 0.2, low: -1, high: 1}]}]
"""
_HEAD = """
from pathlib import Path
from typing import NamedTuple
import numpy as np
{imports}
class Lidar(NamedTuple):
    rays: int = 64
    range_m: float = 8.0
    height_m: float = 0.2
{weights}
class Network:
    lidar = Lidar()
    def reset(self, floors, goals_m): pass
    def init(self, floor, goals_m): return ()
"""
_WEIGHTS = 'W = list(np.load(Path(__file__).with_name("weights.npz")).values())'
_ROW = "np.concatenate([o.ranges_m * 0.125, np.clip(o.goal_robot_m * 0.2, -1, 1)], axis=-1).astype(np.float32)"
_MODULES = {
    "in_numpy": _HEAD.format(imports="jax = False", weights=_WEIGHTS)
    + f"""
    def step(self, o):
        a = np.clip(np.tanh(np.tanh({_ROW} @ W[0]) @ W[1]) @ W[2], -1, 1)
        return np.stack([a[:, 0], 3 * a[:, 1], 0 * a[:, 0]], axis=1)
def controllers(environments): return Network()
""",
    "in_torch": _HEAD.format(imports="import torch\njax = False\ntorch.set_num_threads(1)", weights=_WEIGHTS)
    + f"""
    @torch.inference_mode()
    def step(self, o):
        x = torch.from_numpy({_ROW})
        a = torch.clip(torch.tanh(torch.tanh(x @ T[0]) @ T[1]) @ T[2], -1, 1).numpy()
        return np.stack([a[:, 0], 3 * a[:, 1], 0 * a[:, 0]], axis=1)
T = [torch.from_numpy(w) for w in W]
def controllers(environments): return Network()
""",
    "one_by_one": _HEAD.format(imports="import onnxruntime\njax = False", weights="O = onnxruntime.SessionOptions()")
    + f"""
    def step(self, o):
        a = np.clip(S.run(None, {{"observation": {_ROW}[None]}})[0][0], -1, 1)
        return [a[0], 3 * a[1], 0]
O.intra_op_num_threads = 1
S = onnxruntime.InferenceSession(str(Path(__file__).with_name("policy.onnx")), O)
def controller(environment): return Network()
""",
    "in_jax": _HEAD.format(imports="import jax.numpy as jnp", weights=_WEIGHTS)
    + """
    def step(self, state, o):
        x = jnp.concatenate([o.ranges_m * 0.125, jnp.clip(o.goal_robot_m * 0.2, -1, 1)])
        a = jnp.clip(jnp.tanh(jnp.tanh(x @ W[0]) @ W[1]) @ W[2], -1, 1)
        return state, jnp.stack([a[0], 3 * a[1], 0.0])
def controller(environment): return Network()
""",
}


class Variant(NamedTuple):
    """A way to run the network."""

    told: str
    launch_file: str
    engine: str


VARIANTS = (
    Variant("ONNX, robot by robot, in plain Python on `mujoco`", "one_by_one", "mujoco"),
    Variant("ONNX, robot by robot, in plain Python", "one_by_one", "planar"),
    Variant("NumPy, all robots", "in_numpy", "planar"),
    Variant("torch, all robots", "in_torch", "planar"),
    Variant("ONNX, all robots", "policy", "planar"),
    Variant("JAX, in the compiled loop", "in_jax", "planar"),
)


def written(folder: Path) -> Path:
    """Returns a bundle with the network in every form."""
    layers = weights((66, 64, 64, 2))
    made: onnx.ModelProto = network(layers, ("lanes", 66))
    bundle(folder, made, DECLARED)
    np.savez(folder / "nav/weights.npz", *layers)
    for name, text in _MODULES.items():
        (folder / f"nav/{name}.py").write_text(text)
    return folder


def ready(folder: Path, variant: Variant, lanes: int) -> Run:
    """Returns episodes that only end by time, far beyond what is measured."""
    robot = ApplicationLaunch(name="net", version="1", digest=DIGEST, package="nav", launch_file=variant.launch_file)
    worlds = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(16)}
    requests = [
        EpisodeRequest(
            index=k,
            world=f"hand/apartment-{k % 16}",
            seed=k,
            robot=robot,
            scenario=ENDLESS,
            environment={},
            duration_s=3600.0,
        )
        for k in range(lanes)
    ]
    run = ready_chunk(requests, worlds, {**FOLDERS, DIGEST: folder}, lanes=lanes, engine=variant.engine).run
    if run is None:
        raise RuntimeError("no episode can run")
    return run


def measured(lanes: int, turns: int) -> dict[Variant, list[float]]:
    """Returns the control steps a second of each variant, of each turn."""
    there = [each for each in VARIANTS if "torch" not in each.launch_file or importlib.util.find_spec("torch")]
    with tempfile.TemporaryDirectory() as name:
        runs = {variant: ready(written(Path(name)), variant, lanes) for variant in there}
        states = {variant: run.advance(run.begin())[0] for variant, run in runs.items()}
        found: dict[Variant, list[float]] = {variant: [] for variant in there}
        for _ in range(turns):
            for variant, run in runs.items():
                began, steps = time.perf_counter(), 0
                for _ in range(SLICES):
                    states[variant], record = run.advance(states[variant])
                    steps += np.asarray(record.pose).shape[1]
                found[variant].append(lanes * steps / (time.perf_counter() - began))
        return found


def table(found: dict[Variant, list[float]]) -> str:
    """Returns the medians, the slowest turn and the fastest; beside the first variant, medians and fastest turns."""
    medians = {variant: statistics.median(rates) for variant, rates in found.items()}
    slow, fast = medians[VARIANTS[0]], max(found[VARIANTS[0]])
    rows = [
        [
            each.told,
            f"{medians[each]:,.0f}",
            f"{min(rates):,.0f}",
            f"{max(rates):,.0f}",
            f"{medians[each] / slow:.0f}",
            f"{max(rates) / fast:.0f}",
        ]
        for each, rates in found.items()
    ]
    return markdown([["network", "control steps/s", "from", "to", "x the first", "fastest"], *rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, default=256)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--document", type=Path, help="write the table into it")
    given = parser.parse_args()
    tables = f"{table(measured(given.lanes, given.turns))}\n\n{machine()}"
    print(tables)
    if given.document:
        text = given.document.read_text()
        given.document.write_text(with_tables(text, "host controllers", tables))


if __name__ == "__main__":
    main()
