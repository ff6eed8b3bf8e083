"""Trains a controller that is shown pictures and the way to its goal with skrl's PPO in JAX, and writes it as a bundle.

Run it from the repository: `python examples/training/pictures.py --sensor depth`, or `--sensor color`, then
`simyard run examples/training/pictures.yaml`. It needs `pip install skrl flax optax` (https://skrl.readthedocs.io).

A policy may get worse while it is trained, and one that arrives with the noise by which it explores may not without it.
So every round, 32,768 steps of 256 robots, it drives without noise in homes that it is not trained in. The best policy
is written, and training ends when nearly all arrive. The homes of the gate are others: they decide nothing here.
"""

import argparse
import json
import time
from pathlib import Path

import gymnasium
import numpy as np
from bundle_files import ROBOT, Graph, write_bundle

import simyard
import simyard.gym  # before JAX, whose settings it makes

import flax.linen as nn  # isort: skip
import jax  # isort: skip
import jax.numpy as jnp  # isort: skip
from skrl.agents.jax.ppo import PPO, PPO_CFG  # isort: skip
from skrl.envs.wrappers.jax import wrap_env  # isort: skip
from skrl.memories.jax import RandomMemory  # isort: skip
from skrl.models.jax import DeterministicMixin, GaussianMixin, Model  # isort: skip
from skrl.resources.preprocessors.jax import RunningStandardScaler  # isort: skip
from skrl.resources.schedulers.jax import KLAdaptiveLR  # isort: skip
from skrl.trainers.jax import SequentialTrainer  # isort: skip
from skrl.utils import set_seed  # isort: skip
from skrl.utils.spaces.jax import flatten_tensorized_space, tensorize_space, unflatten_tensorized_space  # isort: skip

HERE = Path(__file__).resolve().parent
CAMERA = {"columns": 64, "rows": 48, "fov_rad": 1.8, "x_m": 0.15, "z_m": 0.35, "rate_hz": 10.0}
# Of each sensor: how it is declared, and the field that it gives as the network is shown it.
SENSORS = {
    "depth": (
        {"depth_camera": {**CAMERA, "range_m": 5.0, "sigma_m_per_m2": 0.002, "edge_dropout": 0.1}},
        {"field": "depth_m", "scale": 0.25, "low": 0.0, "high": 1.0},
    ),
    "color": (
        {"color_camera": {**CAMERA, "light_spread": 0.2, "tint_spread": 0.1, "noise": 0.02}},
        {"field": "color", "scale": 1 / 255},
    ),
}
GOAL = [
    {"field": "goal_robot_m", "scale": 1.0, "low": -1.0, "high": 1.0},
    {"field": "goal_robot_m", "scale": 0.15, "low": -1.0, "high": 1.0},
]
TILE, FILTERS, HIDDEN, ENVS, HORIZON = 8, 16, 64, 256, 32
# Homes of the training and of trials; a trial's robots, with time for two or three times the way; a round's steps.
HOMES, TRIAL_HOMES, TRIALS, TRIAL_S = 16, 8, 64, 10.0
ROUND, ENOUGH = 4 * HORIZON, 0.98


def shown(part, field):
    return jnp.clip(field * part["scale"], part.get("low"), part.get("high"))


def seen(model, inputs):
    """Returns pictures (robots, rows, columns, channels) and ways to goals, as the network's declaration says it."""
    fields = unflatten_tensorized_space(model.observation_space, inputs["observations"])
    picture = shown(model.part, fields[model.part["field"]])
    goal = jnp.concatenate([shown(part, fields[part["field"]]) for part in GOAL], axis=1)
    return picture.reshape(*picture.shape[:3], -1), goal


def layers(picture, goal, numbers):
    """Returns numbers of pictures (robots, rows, columns, channels): a convolution of tiles, then two dense layers."""
    robots, rows, columns, channels = picture.shape
    tiles = picture.reshape(robots, rows // TILE, TILE, columns // TILE, TILE, channels).swapaxes(2, 3)
    seen = nn.relu(nn.Dense(FILTERS, name="tiles")(tiles.reshape(*tiles.shape[:3], -1)))
    hidden = jnp.concatenate([seen.reshape(robots, -1), goal], axis=1)
    for name in ("first", "second"):
        hidden = nn.tanh(nn.Dense(HIDDEN, name=name)(hidden))
    last = nn.initializers.orthogonal(0.01 if numbers > 1 else 1.0)
    return nn.Dense(numbers, name="last", kernel_init=last)(hidden)


class Actor(GaussianMixin, Model):
    part: dict | None = None

    def __init__(self, observation_space, action_space, part, **others):
        Model.__init__(self, observation_space=observation_space, action_space=action_space, **others)
        self.part = part
        GaussianMixin.__init__(self, min_log_std=-2.0)

    @nn.compact
    def __call__(self, inputs, role):  # noqa: ARG002 - as skrl calls it
        spread = self.param("spread", lambda _: jnp.full(self.num_actions, -0.5))
        return layers(*seen(self, inputs), self.num_actions), {"log_std": spread}


class Critic(DeterministicMixin, Model):
    part: dict | None = None

    def __init__(self, observation_space, action_space, part, **others):
        Model.__init__(self, observation_space=observation_space, action_space=action_space, **others)
        self.part = part
        DeterministicMixin.__init__(self)

    @nn.compact
    def __call__(self, inputs, role):  # noqa: ARG002 - as skrl calls it
        return layers(*seen(self, inputs), 1), {}


class Arrivals(gymnasium.vector.VectorWrapper):
    """Keeps which episodes of the training arrived."""

    def __init__(self, env):
        super().__init__(env)
        self.passed = []

    def step(self, actions):
        answer = self.env.step(actions)
        if "final_info" in answer[4]:
            ends = answer[4]["final_info"]
            self.passed += ends["passed"][ends["_passed"]].tolist()
        return answer


def trial(envs, policy):
    """Returns the share of robots that arrive without noise, each in one episode: the same ones at each call."""
    seen, _ = envs.reset(seed=0)
    driving, passed = np.ones(envs.num_envs, bool), np.zeros(envs.num_envs, bool)
    while driving.any():
        observations = flatten_tensorized_space(tensorize_space(envs.single_observation_space, seen))
        mean, _ = policy.apply(policy.state_dict.params, {"observations": observations}, "policy")
        seen, _, terminated, truncated, infos = envs.step(np.asarray(mean))
        over = driving & (terminated | truncated)
        passed[over] = infos["passed"][over] if over.any() else False
        driving &= ~over
    return float(passed.mean())


def train(envs, trials, part, steps, seed):
    """Returns the weights of the best actor, and the curve: of each round, what arrived in training and in a trial."""
    set_seed(seed)
    arrivals = Arrivals(envs)
    env = wrap_env(arrivals, verbose=False)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    models = {"policy": Actor(**spaces, part=part), "value": Critic(**spaces, part=part)}
    for role, model in models.items():
        model.init_state_dict(role=role, key=jax.random.key(seed))
    chosen = PPO_CFG(
        rollouts=HORIZON,
        learning_epochs=4,
        mini_batches=4,
        learning_rate=1e-3,
        learning_rate_scheduler=KLAdaptiveLR,
        learning_rate_scheduler_kwargs={"kl_threshold": 0.01, "max_lr": 1e-3},
        entropy_loss_scale=2e-3,
        value_loss_scale=1.0,
        value_preprocessor=RunningStandardScaler,
        value_preprocessor_kwargs={"size": 1},
    )
    chosen.experiment.write_interval = chosen.experiment.checkpoint_interval = 0
    memory = RandomMemory(memory_size=HORIZON, num_envs=envs.num_envs)
    agent = PPO(models=models, memory=memory, cfg=chosen, **spaces)
    told = {"timesteps": ROUND, "headless": True, "disable_progressbar": True}
    trainer = SequentialTrainer(env=env, agents=agent, cfg=told)
    best, weights, points, began = -1.0, None, [], time.monotonic()
    for number in range(1, max(1, steps // (ROUND * envs.num_envs)) + 1):
        trainer.train()
        arrive, alone = float(np.mean(arrivals.passed[-1000:] or [0])), trial(trials, models["policy"])
        points.append([number * ROUND * envs.num_envs, round(time.monotonic() - began, 1), arrive, alone])
        print("{:>9,} steps, {:4.0f} s: {:.0%} arrive, {:.0%} of a trial".format(*points[-1]), flush=True)
        if alone > best:
            best, weights = alone, jax.tree.map(np.array, models["policy"].state_dict.params["params"])
        if best >= ENOUGH:
            break
    return weights, points


def write(folder, weights, sensors, part):
    """Writes the actor in ONNX, with a convolution in place of the tiles, as a bundle."""
    (camera,) = sensors.values()
    kernel, bias = weights["tiles"]["kernel"], weights["tiles"]["bias"]
    kernel = kernel.reshape(TILE, TILE, -1, FILTERS).transpose(3, 2, 0, 1)
    graph = Graph("seeing")
    planes = graph.add("Transpose", ["picture"], "planes", perm=[0, 3, 1, 2])
    tiles = graph.add("Conv", [planes, kernel, bias], "tiles", strides=[TILE, TILE])
    last = graph.add("Transpose", [graph.add("Relu", [tiles], "seen")], "last", perm=[0, 2, 3, 1])
    both = graph.add("Concat", [graph.add("Flatten", [last], "flat"), "goal"], "both", axis=1)
    graph.dense(both, [(weights[name]["kernel"], weights[name]["bias"]) for name in ("first", "second", "last")])
    shapes = {"picture": (camera["rows"], camera["columns"], kernel.shape[1]), "goal": (2 * len(GOAL),)}
    inputs = [{"name": "picture", "parts": [part]}, {"name": "goal", "parts": GOAL}]
    write_bundle(folder, graph, shapes, len(weights["last"]["bias"]), {**sensors, "inputs": inputs})


def drawing(points):
    """Returns the curve as SVG: thin what arrived in training, bold what arrived in trials, over thousands of steps."""
    wide, high, most = 560, 240, points[-1][0]
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide + 70} {high + 60}">']
    ground = '<rect width="100%" height="100%" fill="#fff"/>'
    parts.append(f'<style>text{{font-size:12px}}</style>{ground}<g transform="translate(50 20)">')
    for part in range(5):
        x, y = wide * part / 4, high * (1 - part / 4)
        parts.append(f'<path d="M0 {y}H{wide}" stroke="#ddd"/><text x="-44" y="{y + 4}">{25 * part} %</text>')
        parts.append(f'<text x="{x}" y="{high + 18}" text-anchor="middle">{most * part / 4000:.0f}</text>')
    for column, width, color in ((2, 1.5, "#888"), (3, 3, "#06c")):
        line = " ".join(f"{wide * each[0] / most:.1f},{high * (1 - each[column]):.1f}" for each in points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="{width}"/>')
    legend = "thousand steps; who arrives: gray in training, with noise; blue in trials, without"
    return "\n".join([*parts, f'<text x="{wide / 2}" y="{high + 36}" text-anchor="middle">{legend}</text></g></svg>\n'])


def main():
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--sensor", choices=SENSORS, default="depth")
    asked.add_argument("--steps", type=int, default=500_000, help="control steps of all robots together, at most")
    asked.add_argument("--envs", type=int, default=ENVS, help="robots at once")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--output", type=Path, default=HERE / "seeing", help="folder of the bundle")
    given = asked.parse_args()
    sensors, part = SENSORS[given.sensor]
    homes = [each.document for each in simyard.worlds(HERE / "rooms.yaml", count=HOMES + TRIAL_HOMES, seed=given.seed)]
    task = {
        "robot": ROBOT.parent,
        "sensors": sensors,
        "observation": (part["field"], "goal_robot_m"),
        "environment": {"GOALS": "1"},
    }
    vector = simyard.gym.SimyardVectorEnv
    envs = vector(given.envs, worlds=homes[:HOMES], duration_s=30.0, autoreset_mode="SameStep", **task)
    trials = vector(min(TRIALS, given.envs), worlds=homes[HOMES:], duration_s=TRIAL_S, **task)
    began = time.monotonic()
    weights, points = train(envs, trials, part, given.steps, given.seed)
    write(given.output, weights, sensors, part)
    names = ("steps", "seconds", "arrive", "trial")
    curve = [dict(zip(names, each, strict=True)) for each in points]
    (given.output / "curve.json").write_text(json.dumps(curve))
    (given.output / "curve.svg").write_text(drawing(points))
    print(f"{given.output}: trained in {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
