"""The engines that drive episodes, by name: a module of its own, since who simulates reads no documents."""

from typing import Literal

EngineName = Literal["planar", "mjx", "mujoco"]
