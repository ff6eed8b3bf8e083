"""The smallest thing to deploy: a robot, a scenario that it passes at once, and a document."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.attacks.conftest import Owner
from tests.repository import ROOT

FLEET, ROBOT = "couriers", "couriers-1"
_MODEL = """<mujoco model="slider">
  <option timestep="0.01"/>
  <worldbody>
    <body name="base" pos="0 0 0.2">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="yaw" type="hinge" axis="0 0 1"/>
      <geom name="hull" type="sphere" size="0.15" mass="1.5" condim="1"/>
    </body>
  </worldbody>
  <actuator>
    <velocity name="x" joint="x" kv="30" ctrlrange="-1 1"/>
    <velocity name="y" joint="y" kv="30" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
_CONTROLLER = """import jax.numpy as jnp


class Still:
    def __init__(self, speed):
        self._speed = speed

    def init(self, floor, goals_m):
        return ()

    def step(self, state, observation):
        return state, jnp.zeros(2) * self._speed


def controller(environment):
    return Still(environment.get("SPEED", 0.5))
"""
_SCENARIO = """from typing import NamedTuple

import jax.numpy as jnp
import numpy as np


class Placement(NamedTuple):
    start: np.ndarray
    goals_m: np.ndarray


class Verdict(NamedTuple):
    goal_index: object
    done: object
    reason: object


class AtOnce:
    arrived_m = None

    def place(self, world, floor, hull_radius_m, rng):
        return Placement(np.zeros(3), np.ones((1, 2)))

    def init(self, start, goals_m):
        return ()

    def step(self, state, truth):
        return state, Verdict(jnp.ones((), jnp.int32), jnp.array(True), jnp.zeros((), jnp.int32))


def scenario(environment):
    return AtOnce()
"""


def bundle(folder: Path, marker: Path | None = None, note: str = "") -> Path:
    """Returns a folder with the slider, whose launch script leaves a file at the marker.

    Args:
        folder: Made, with what it needs.
        marker: Where the script says that it ran; None for nowhere.
        note: Makes another bundle of it.
    """
    package = folder / "slider"
    package.mkdir(parents=True)
    (folder / "robot.xml").write_text(_MODEL)
    (package / "still.py").write_text(_CONTROLLER)
    leave = f'echo "$SPEED" >>{marker}\n' if marker else ""
    (package / "run.sh").write_text(f"#!/bin/sh\n# {note}\n{leave}while :; do sleep 1; done\n")
    (package / "run.sh").chmod(0o755)
    return folder


def publish(owner: Owner, *bundles: str) -> str:
    """Returns what `simyard app publish` says of the slider, once the scenario is published, too.

    Args:
        owner: Publishes them.
        bundles: A folder, or ``--architecture ARCHITECTURE=FOLDER`` for each of some.
    """
    scenario = owner.folder / "scenario" / "at_once"
    if not scenario.exists():
        scenario.mkdir(parents=True)
        (scenario / "at_once.py").write_text(_SCENARIO)
        done(owner, "app", "publish", "at_once", str(scenario.parent), "--kind", "simulation")
    return done(owner, "app", "publish", "slider", *bundles)


def document(
    owner: Owner, *, simulated: Mapping[str, str] | None = None, deployed: Mapping[str, str] | None = None
) -> str:
    """Returns the path of a document that drives the slider 16 times, judges it, and deploys it to one robot.

    Args:
        owner: Keeps it.
        simulated: Variables of the robot application in the simulation.
        deployed: Variables of the launch configuration on robots.
    """
    content: dict[str, Any] = {
        "name": "attacked",
        "worldGeneration": {"template": str(ROOT / "examples/templates/two-rooms.json"), "worldCount": {}},
        "simulationBatch": {
            "matrix": {"worlds": "all", "seeds": 16},
            "audit": {"lanes": 0},
            "recordings": {"episodes": "none"},
            "createSimulationJobRequests": [
                {
                    "maxJobDurationInSeconds": 1,
                    "robotApplications": [_use("slider", "still", simulated)],
                    "simulationApplications": [_use("at_once", "at_once", None)],
                }
            ],
        },
        "gate": {"successRate": {"atLeast": 0.5}},
        "deployment": {
            "fleet": {"name": FLEET, "localAgents": 1},
            "deploymentApplicationConfigs": [_use("slider", "run.sh", deployed)],
        },
    }
    content["worldGeneration"]["worldCount"] = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    file = owner.folder / "document.yaml"
    file.write_text(json.dumps(content))
    return str(file)


def done(owner: Owner, *arguments: str) -> str:
    """Returns what a command says that the owner gives and that does what it shall."""
    ended = owner.simyard(*arguments)
    assert ended.returncode == 0, ended.stdout
    return ended.stdout


def _use(application: str, file: str, variables: Mapping[str, str] | None) -> dict[str, Any]:
    launch = {"packageName": application, "launchFile": file}
    return {
        "application": application,
        "launchConfig": {**launch, **({"environmentVariables": dict(variables)} if variables else {})},
    }
