"""Gymnasium environments of Simyard's worlds, and data sets of what robots did. Programs that train import it."""

import importlib.util
import sys

from tasks.simulate.devices import prepare_devices

if importlib.util.find_spec("gymnasium") is None:
    raise ImportError('simyard.gym needs Gymnasium: pip install "simyard[gym]"', name="gymnasium")
if "jax" not in sys.modules:  # else an environment says what to do, when one is made
    prepare_devices()

from simyard.gym.datasets import Rollout, collect, export_minari
from simyard.gym.single_env import SimyardEnv, register_environments
from simyard.gym.vector_env import SimyardVectorEnv

register_environments()

__all__ = ["Rollout", "SimyardEnv", "SimyardVectorEnv", "collect", "export_minari"]
