"""Trains a controller that sees pictures and the way to its goal with skrl's PPO in JAX, and writes it as a bundle.

Run it from the repository: `python examples/training/pictures.py --sensor depth`, or `--sensor color`, then
`simyard run examples/training/pictures.yaml`. It needs `pip install skrl flax optax` (https://skrl.readthedocs.io).
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
from skrl.utils.spaces.jax import unflatten_tensorized_space  # isort: skip

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


class Curve(gymnasium.vector.VectorWrapper):
    """Keeps which episodes arrived, and prints how many of the last ones did."""

    def __init__(self, env, every):
        super().__init__(env)
        self.passed, self.points, self._steps, self._every, self._began = [], [], 0, every, time.monotonic()

    def step(self, actions):
        answer = self.env.step(actions)
        self._steps += self.num_envs
        if "final_info" in answer[4]:
            ends = answer[4]["final_info"]
            self.passed += ends["passed"][ends["_passed"]].tolist()
        if self._steps // self.num_envs % self._every == 0:
            rate, seconds = float(np.mean(self.passed[-1000:] or [0])), time.monotonic() - self._began
            self.points.append({"steps": self._steps, "seconds": round(seconds, 1), "arrive": round(rate, 4)})
            print(f"{self._steps:>9,} steps, {seconds:4.0f} s: {rate:.0%} arrive", flush=True)
        return answer


def train(envs, part, steps, seed):
    """Returns the actor's weights after some control steps of all robots together."""
    set_seed(seed)
    env = wrap_env(envs, verbose=False)
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
        learning_rate_scheduler_kwargs={"kl_threshold": 0.01, "max_lr": 2e-3},
        entropy_loss_scale=2e-3,
        value_loss_scale=1.0,
        value_preprocessor=RunningStandardScaler,
        value_preprocessor_kwargs={"size": 1},
    )
    chosen.experiment.write_interval = chosen.experiment.checkpoint_interval = 0
    memory = RandomMemory(memory_size=HORIZON, num_envs=envs.num_envs)
    agent = PPO(models=models, memory=memory, cfg=chosen, **spaces)
    told = {"timesteps": steps // envs.num_envs, "headless": True, "disable_progressbar": True}
    SequentialTrainer(env=env, agents=agent, cfg=told).train()
    return jax.tree.map(np.asarray, models["policy"].state_dict.params["params"])


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


def main():
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--sensor", choices=SENSORS, default="depth")
    asked.add_argument("--steps", type=int, default=600_000, help="control steps of all robots together")
    asked.add_argument("--envs", type=int, default=ENVS, help="robots at once")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--output", type=Path, default=HERE / "seeing", help="folder of the bundle")
    given = asked.parse_args()
    sensors, part = SENSORS[given.sensor]
    envs = simyard.gym.SimyardVectorEnv(
        given.envs,
        worlds=simyard.worlds(HERE / "rooms.yaml", count=16, seed=given.seed),
        robot=ROBOT.parent,
        sensors=sensors,
        observation=(part["field"], "goal_robot_m"),
        environment={"GOALS": "1"},
        duration_s=30.0,
        autoreset_mode="SameStep",
    )
    curve, began = Curve(envs, HORIZON * 4), time.monotonic()
    weights = train(curve, part, given.steps, given.seed)
    write(given.output, weights, sensors, part)
    (given.output / "curve.json").write_text(json.dumps(curve.points))
    print(f"{given.output}: trained in {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
