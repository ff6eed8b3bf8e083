"""Trains a controller that sees pictures, what is beside it and the way to its goal, and writes a bundle.

Its teacher is the shipped courier with its map and its lidar. The pupil drives, the teacher says what it would do at
each picture, and the pupil learns that from all pictures so far: S. Ross, G. Gordon, D. Bagnell, A Reduction of
Imitation Learning and Structured Prediction to No-Regret Online Learning, 2011 (arXiv:1011.0686), with Adam of
`jax.example_libraries`. Run it from the repository: `python examples/training/pictures.py --sensor depth`, or
`--sensor color`, then `simyard run examples/training/pictures.yaml`. Last it drives with pictures of nothing, too.
"""

import argparse
import json
import sys
import time
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import yaml
from bundle_files import ROBOT, Graph, write_bundle
from onnx import TensorProto

import simyard
import simyard.gym  # before JAX, whose settings it makes
from flows.pipeline.world_imports import import_worlds
from specs.pipeline.world_sections import WorldImport
from tasks.simulate.application.contract import FloorMap, Observation
from tasks.simulate.application.robot_model import hull_of
from tasks.simulate.geometry.world_arrays import arrays_of_worlds

import jax  # isort: skip
import jax.numpy as jnp  # isort: skip
from jax.example_libraries.optimizers import adam, inverse_time_decay  # isort: skip

sys.path.insert(0, str(ROBOT.parent))
from courier.giving_way import nobody, room_of
from courier.go_to_goal import GoToGoal, Kept, Lidar
from courier.planning import Ways, ways_to_goals

HERE = Path(__file__).resolve().parent
DOCUMENT = yaml.safe_load((HERE / "pictures.yaml").read_text())
# On a mast at the rear, from where it sees what is beside the robot, too.
CAMERA = {"columns": 64, "rows": 48, "fov_rad": 2.2, "x_m": -0.15, "z_m": 0.42, "rate_hz": 10.0}
# What passes the picture's borders as the robot turns: two ultrasonic sensors look to the right and to the left.
SIDES = {
    "finders": 2,
    "first_rad": -1.5,
    "apart_rad": 3.0,
    "cone_rad": 0.9,
    "range_m": 1.0,
    "z_m": 0.15,
    "sigma_m": 0.01,
}
# Of each sensor: how it is declared, the field that it gives as the network is shown it, and its channels.
SENSORS = {
    "depth": (
        {"depth_camera": {**CAMERA, "range_m": 5.0, "sigma_m_per_m2": 0.002, "edge_dropout": 0.1}},
        {"field": "depth_m", "scale": 0.4, "low": 0.0, "high": 1.0},
        1,
    ),
    "color": (
        {"color_camera": {**CAMERA, "light_spread": 0.2, "tint_spread": 0.1, "noise": 0.02}},
        {"field": "color", "scale": 1 / 255, "low": 0.0, "high": 1.0},
        3,
    ),
}
# What is told beside the picture: the way to the goal, far and near, and the sides.
TOLD = [
    {"field": "goal_robot_m", "scale": 1.0, "low": -1.0, "high": 1.0},
    {"field": "goal_robot_m", "scale": 0.15, "low": -1.0, "high": 1.0},
    {"field": "finder_m", "scale": 1.0, "low": 0.0, "high": 1.0},
]
# What the pupil chooses from, in m/s ahead and rad/s: never backwards, where it sees nothing. All have mirror images.
TURNS = {0.5: (-0.9, -0.3, 0.0, 0.3, 0.9), 0.25: (-1.6, -0.6, 0.6, 1.6), 0.08: (0.0,), 0.0: (-2.4, 2.4)}
CONTROLS = np.array([(speed, turn) for speed, turns in TURNS.items() for turn in turns], np.float32)
# Speeds that are so far apart weigh as much as turns that are.
APART = np.array([0.25, 0.6])
# How much better a turn to the other side must be after one to this side: who sees as much to the left as to the right
# of a box would turn to and fro before it.
TURNED = np.where(np.abs(CONTROLS[:, 1]) > 0.5, np.sign(CONTROLS[:, 1]), 0)
SWERVE = np.minimum(3.0 * np.outer(TURNED, TURNED), 0).astype(np.float32)
# Who turns on the spot for more than so many steps tires of it: where two ways around a box are as good, he would turn
# from one to the other, and drive none. What he has turned fades step by step.
SPOT = (CONTROLS[:, :1] == 0).astype(np.float32)
RESTED, TIRING, FADING = np.float32([20.0, 0.1, 0.99])
CARE_M = 0.08  # so much wider than it is the teacher drives
SCAN_M = 0.1  # how high its lidar is: the shipped one looks over pallets
NEAR_M, NEAR_WEIGHT = 0.4, 3.0  # what is learned where a ray is shorter than that weighs more
TILE, FILTERS, HIDDEN, BATCH, STEPS, EVERY = 8, 24, 96, 256, 600, 4
HOMES, SEEDS, CHECKS = 16, 3, 128


def shown(part, seen):
    return np.clip(seen[part["field"]] * np.float32(part["scale"]), part["low"], part["high"])


def inputs(part, seen):
    """Returns pictures (robots, rows, columns, channels) in bytes, and ways to goals, as the declaration has them."""
    picture = np.rint(255 * shown(part, seen)).astype(np.uint8)
    told = np.concatenate([shown(each, seen) for each in TOLD], axis=1, dtype=np.float32)
    return picture.reshape(*picture.shape[:3], -1), told


def nearest(controls):
    """Returns which choice comes nearest to each control."""
    return (((controls[:, None, :2] - CONTROLS) / APART) ** 2).sum(axis=2).argmin(axis=1)


def mirrored(told):
    """Returns what is told in a mirror: the goal and the sides change places."""
    return told[:, [0, 1, 2, 3, 5, 4]] * np.float32([1, -1, 1, -1, 1, 1])


class Teacher:
    """The courier, once for each robot, with the way to its goal."""

    def __init__(self, worlds, robots):
        arrays = arrays_of_worlds(
            {f"{each.generation}/{each.name}": each for each in worlds},
            hull_of(mujoco.MjModel.from_xml_path(str(ROBOT))),
            SCAN_M,
        )
        self.floors = {name: FloorMap(*map(jnp.asarray, each.floor)) for name, each in arrays.items()}
        self.floors = {name: each._replace(clearance_m=each.clearance_m - CARE_M) for name, each in self.floors.items()}
        side = max(len(each.clearance_m) for each in self.floors.values())
        self.known = {}
        self.ways = Ways(
            np.zeros((robots, 1, side, side), np.uint8), np.zeros((robots, 2), np.float32), np.ones(robots, np.float32)
        )
        courier = GoToGoal(0.5, Lidar())

        everywhere = room_of(next(iter(self.floors.values())))._replace(units=jnp.zeros((1, 1), jnp.uint8))

        def control(ways, pose, goal_m, ranges_m):
            seen = Observation(
                jnp.zeros(()), pose, pose, ranges_m - CARE_M, jnp.int32(0), goal_m, goal_m, jnp.zeros(1, bool)
            )
            # Nobody walks here: all that a scan ends on is the map's.
            return courier.step(Kept(ways, everywhere, nobody(), None), seen)[1]

        self.plan, self.control = jax.jit(ways_to_goals), jax.jit(jax.vmap(control))

    def begin(self, seen, infos, robots):
        """Plans the ways of robots that have begun an episode."""
        for robot in robots:
            episode = infos["world"][robot], infos["seed"][robot]
            if episode not in self.known:
                planned = self.plan(self.floors[episode[0]], seen["goal_m"][robot][None])
                self.known[episode] = [np.asarray(each) for each in planned]
            cells, origin_m, cell_m = self.known[episode]
            self.ways.next_cell[robot, :, : cells.shape[1], : cells.shape[2]] = cells
            self.ways.origin_m[robot], self.ways.cell_m[robot] = origin_m, cell_m

    def controls(self, seen):
        return np.asarray(self.control(self.ways, seen["pose"], seen["goal_m"], seen["ranges_m"]))


def fresh(key, channels):
    tiles = CAMERA["rows"] // TILE * (CAMERA["columns"] // TILE)
    sizes = {
        "tiles": (TILE * TILE * channels, FILTERS),
        "first": (tiles * FILTERS + 2 * len(TOLD), HIDDEN),
        "second": (HIDDEN, HIDDEN),
        "last": (HIDDEN, len(CONTROLS)),
    }
    keys = zip(jax.random.split(key, len(sizes)), sizes.items(), strict=True)
    return {name: (jax.random.normal(own, size) / size[0] ** 0.5, jnp.zeros(size[1])) for own, (name, size) in keys}


def scores(weights, picture, told):
    """Returns a score of each choice: a convolution of tiles, then two dense layers."""

    def dense(name, given):
        return given @ weights[name][0] + weights[name][1]

    robots, rows, columns, channels = picture.shape
    tiles = picture.reshape(robots, rows // TILE, TILE, columns // TILE, TILE, channels).swapaxes(2, 3) / 255
    seen = jax.nn.relu(dense("tiles", tiles.reshape(*tiles.shape[:3], -1))).reshape(robots, -1)
    first = jnp.tanh(dense("first", jnp.concatenate([seen, told], axis=1)))
    return dense("last", jnp.tanh(dense("second", first)))


def loss(weights, picture, told, wanted, weight):
    likely = jnp.take_along_axis(jax.nn.log_softmax(scores(weights, picture, told)), wanted[:, None], axis=1)[:, 0]
    return -jnp.sum(weight * likely) / jnp.sum(weight)


@jax.jit
def choice(weights, picture, told, memory):
    """Returns which control is chosen, given the last one as ones and zeros and turns on the spot, and both anew."""
    last, spun = memory[:, :-1], memory[:, -1:]
    tired = TIRING * jax.nn.relu(spun - RESTED) @ SPOT.T
    best = (scores(weights, picture, told) + last @ SWERVE - tired).argmax(axis=1)
    chosen = jax.nn.one_hot(best, len(CONTROLS))
    return best, jnp.concatenate([chosen, FADING * spun + chosen @ SPOT], axis=1)


class Pupil:
    def __init__(self, part, channels, seed):
        self.part, self.rng = part, np.random.default_rng(seed)
        start, update, self.weights_of = adam(inverse_time_decay(1e-3, decay_steps=5000, decay_rate=1.0))
        self.state, self.updates = start(fresh(jax.random.key(seed), channels)), 0

        @jax.jit
        def learned(state, number, *batch):
            return update(number, jax.grad(loss)(self.weights_of(state), *batch), state)

        self.learned = learned

    def controls(self, seen, memory, pictures=np.asarray):
        picture, told = inputs(self.part, seen)
        best, memory = choice(self.weights_of(self.state), pictures(picture), told, memory)
        return CONTROLS[np.asarray(best)], np.array(memory)

    def learn(self, samples, passes):
        """Takes steps of Adam over all samples, each batch as it was or in a mirror."""
        mirror = nearest(CONTROLS * [1, -1])
        for _ in range(passes):
            order = self.rng.permutation(len(samples[0]))
            for batch in order[: len(order) // BATCH * BATCH].reshape(-1, BATCH) if len(order) > BATCH else [order]:
                picture, told, wanted, weight = (each[batch] for each in samples)
                if self.rng.random() < 0.5:
                    picture, told, wanted = picture[:, :, ::-1], mirrored(told), mirror[wanted]
                self.state = self.learned(self.state, self.updates, picture, told, wanted, weight)
                self.updates += 1


def no_memory(robots):
    return np.zeros((robots, len(CONTROLS) + 1), np.float32)


def lesson(envs, teacher, pupil, seed, steps):
    """Returns what the teacher says while the pupil drives, itself at first, and the share of robots that arrived."""
    seen, infos = envs.reset(seed=seed)
    teacher.begin(seen, infos, range(envs.num_envs))
    samples, passed, memory = [], [], no_memory(envs.num_envs)
    for step in range(steps):
        wanted = teacher.controls(seen)
        if step % EVERY == 0:
            weight = np.where(seen["ranges_m"].min(axis=1) < NEAR_M, np.float32(NEAR_WEIGHT), np.float32(1.0))
            samples.append((*inputs(pupil.part, seen), nearest(wanted), weight))
        controls, memory = pupil.controls(seen, memory) if pupil.updates else (wanted[:, :2], memory)
        seen, _, terminated, truncated, infos = envs.step(controls)
        if (over := terminated | truncated).any():
            passed += infos["final_info"]["passed"][over].tolist()
            teacher.begin(seen, infos, np.flatnonzero(over))
            memory[over] = 0
    return [np.concatenate(each) for each in zip(*samples, strict=True)], float(np.mean(passed or [0]))


def arriving(envs, drive):
    """Returns the share of robots that arrive, each in one episode: the same ones at each call."""
    seen, _ = envs.reset(seed=0)
    driving, passed = np.ones(envs.num_envs, bool), np.zeros(envs.num_envs, bool)
    memory = no_memory(envs.num_envs)
    while driving.any():
        controls, memory = drive(seen, memory)
        seen, _, terminated, truncated, infos = envs.step(controls)
        over = driving & (terminated | truncated)
        if over.any():
            passed[over] = infos["final_info"]["passed"][over]
        driving &= ~over
    return float(passed.mean())


def straight(seen, memory):
    """Drives towards the goal, whatever is in the way."""
    error = np.arctan2(*seen["goal_robot_m"].T[::-1])
    return np.stack([0.5 * np.maximum(np.cos(error), 0) ** 2, np.clip(2.5 * error, -2.4, 2.4)], axis=1), memory


def halls(count, seed):
    """Returns halls as those of the gate, of another seed."""
    asked = {**DOCUMENT["worlds"][0], "variants": count, "seed": seed}
    return [each.world for each in import_worlds(WorldImport.model_validate(asked), HERE)]


def write(folder, weights, sensors, part):
    """Writes the pupil in ONNX, with a convolution in place of the tiles, as a bundle."""
    kernel, bias = weights["tiles"]
    kernel = kernel.reshape(TILE, TILE, -1, FILTERS).transpose(3, 2, 0, 1)
    graph = Graph("seeing")
    planes = graph.add("Transpose", ["picture"], "planes", perm=[0, 3, 1, 2])
    tiles = graph.add("Conv", [planes, kernel, bias], "tiles", strides=[TILE, TILE])
    tiles = graph.add("Transpose", [graph.add("Relu", [tiles], "seen")], "tiles_last", perm=[0, 2, 3, 1])
    both = graph.add("Concat", [graph.add("Flatten", [tiles], "flat"), "told"], "both", axis=1)
    seen = graph.dense(both, [weights[name] for name in ("first", "second", "last")], "seen_only")
    held = graph.add("Add", [seen, graph.add("MatMul", ["last_choice", SWERVE], "swerve")], "held")
    tired = graph.add("Relu", [graph.add("Sub", ["spun", RESTED], "beyond")], "tired")
    action = graph.add("Sub", [held, graph.add("MatMul", [tired, TIRING * SPOT.T], "tiring")], "action")
    best = graph.add("ReduceMax", [action], "best", axes=[1])
    chosen = graph.add("Cast", [graph.add("Equal", [action, best], "chosen")], "choice", to=TensorProto.FLOAT)
    on_the_spot = graph.add("MatMul", [chosen, SPOT], "on_the_spot")
    graph.add("Add", [on_the_spot, graph.add("Mul", ["spun", FADING], "faded")], "spun_next")
    inputs = {
        "picture": (CAMERA["rows"], CAMERA["columns"], kernel.shape[1]),
        "told": (2 * len(TOLD),),
        "last_choice": (len(CONTROLS),),
        "spun": (1,),
    }
    outputs = {"action": (len(CONTROLS),), "choice": (len(CONTROLS),), "spun_next": (1,)}
    declared = {
        **sensors,
        "inputs": [{"name": "picture", "parts": [part]}, {"name": "told", "parts": TOLD}],
        "states": [{"input": "last_choice", "output": "choice"}, {"input": "spun", "output": "spun_next"}],
        "output": {"name": "action", "kind": "choice", "controls": CONTROLS.astype(float).round(6).tolist()},
    }
    write_bundle(folder, graph, inputs, outputs, declared)


def drawing(curve):
    """Returns the curve as SVG: who arrives among those whom the pupil drives, over the rounds' seconds."""
    wide, high, most = 560, 240, curve[-1]["seconds"]
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide + 80} {high + 60}">']
    ground = '<rect width="100%" height="100%" fill="#fff"/>'
    parts.append(f'<style>text{{font-size:12px}}</style>{ground}<g transform="translate(50 20)">')
    for part in range(5):
        x, y = wide * part / 4, high * (1 - part / 4)
        parts.append(f'<path d="M0 {y}H{wide}" stroke="#ddd"/><text x="-44" y="{y + 4}">{25 * part} %</text>')
        parts.append(f'<text x="{x}" y="{high + 18}" text-anchor="middle">{most * part / 4:.0f} s</text>')
    points = [(wide * each["seconds"] / most, high * (1 - each["arrive"])) for each in curve]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    parts.append(f'<polyline points="{line}" fill="none" stroke="#06c" stroke-width="2"/>')
    parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="#06c"/>' for x, y in points]
    legend = "who arrives in training: first as the teacher drives, then as the pupil does"
    return "\n".join([*parts, f'<text x="{wide / 2}" y="{high + 36}" text-anchor="middle">{legend}</text></g></svg>\n'])


def main():
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--sensor", choices=SENSORS, default="depth")
    asked.add_argument("--rounds", type=int, default=9, help="the teacher drives in the first of them")
    asked.add_argument("--steps", type=int, default=STEPS, help="control steps of a round")
    asked.add_argument("--passes", type=int, default=3, help="over all samples, after a round; thrice after the last")
    asked.add_argument("--envs", type=int, default=128, help="robots at once")
    asked.add_argument("--halls", type=int, default=320)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--output", type=Path, default=HERE / "seeing", help="folder of the bundle")
    given = asked.parse_args()
    camera, part, channels = SENSORS[given.sensor]
    sensors = {**camera, "range_finders": SIDES}
    began = time.monotonic()
    homes = simyard.worlds(HERE / "rooms.yaml", count=min(HOMES, given.halls), seed=given.seed)
    worlds = [*halls(given.halls, given.seed), *(each.document for each in homes)]
    task = {
        "robot": ROBOT.parent,
        "sensors": {**sensors, "lidar": {"rays": 32, "range_m": 10.0, "height_m": SCAN_M}},  # of the teacher
        "observation": (part["field"], "goal_robot_m", "finder_m", "goal_m", "pose", "ranges_m"),
        "environment": DOCUMENT["simulationBatch"]["createSimulationJobRequests"][0]["simulationApplications"][0][
            "launchConfig"
        ]["environmentVariables"],
        "duration_s": 60.0,
        "actions": "raw",
        "autoreset_mode": "SameStep",
    }
    envs = simyard.gym.SimyardVectorEnv(given.envs, worlds=worlds, seeds=SEEDS, **task)
    teacher, pupil = Teacher(worlds, given.envs), Pupil(part, channels, given.seed)
    rounds, curve = [], []
    for number in range(given.rounds):
        samples, arrive = lesson(envs, teacher, pupil, given.seed + 10_000 * number, given.steps)
        rounds.append(samples)
        last = number == given.rounds - 1
        pupil.learn([np.concatenate(each) for each in zip(*rounds, strict=True)], given.passes * (3 if last else 1))
        curve.append({"seconds": round(time.monotonic() - began, 1), "arrive": arrive})
        print("round {}, {seconds:4.0f} s: {arrive:.0%} arrive".format(number, **curve[-1]), flush=True)
    write(given.output, jax.tree.map(np.asarray, pupil.weights_of(pupil.state)), sensors, part)
    (given.output / "curve.json").write_text(json.dumps(curve))
    (given.output / "curve.svg").write_text(drawing(curve))
    print(f"{given.output}: trained in {time.monotonic() - began:.0f} s", flush=True)
    checks = min(CHECKS, given.envs)
    unseen = simyard.gym.SimyardVectorEnv(checks, worlds=halls(min(16, given.halls), given.seed + 500), **task)
    floor = np.median(np.concatenate([each[0][::50] for each in rounds]), axis=0).astype(np.uint8)

    def pupil_shown(pictures):
        return partial(pupil.controls, pictures=pictures)

    sight = {
        "its pictures": arriving(unseen, pupil.controls),
        "an open floor for a picture": arriving(unseen, pupil_shown(lambda each: np.broadcast_to(floor, each.shape))),
        "another robot's pictures": arriving(unseen, pupil_shown(lambda each: np.roll(each, 1, axis=0))),
        "no network, straight ahead": arriving(unseen, straight),
    }
    (given.output / "sight.json").write_text(json.dumps(sight))
    for name, share in sight.items():
        print(f"{share:.0%} of {checks} robots arrive in halls that are new to it with {name}")


if __name__ == "__main__":
    main()
