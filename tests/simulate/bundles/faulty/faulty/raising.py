"""A controller that raises when it is traced."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

from tasks.simulate.application.contract import Observation

from .pushing import Control, Pushing, Steps


class Raising(Pushing):
    def step(self, state: Steps, observation: Observation) -> tuple[Steps, Control]:
        raise RuntimeError("no idea where to go")


def controller(environment: Mapping[str, object]) -> Raising:
    return Raising(0.0)
