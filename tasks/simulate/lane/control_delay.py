"""Commands on their way: what a controller decides reaches the actuators some control steps later.

Until the first one is there, actuators get what they get at rest. How old a command is when it arrives is a number of
the lane, so that one program serves all delays.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from specs.data.physics import MOST_DELAY_STEPS

Commands = Float[jax.Array, "steps actuators"]
"""Those of the last control steps, the newest first."""


def no_commands(rest_control: Float[np.ndarray, "actuators"]) -> Commands:
    """Returns those of a lane whose controller has decided nothing yet."""
    return jnp.tile(jnp.asarray(rest_control), (MOST_DELAY_STEPS, 1))


def delivered(
    commands: Commands, control: Float[jax.Array, "actuators"], delay_steps: Int[jax.Array, ""]
) -> Float[jax.Array, "actuators"]:
    """Returns what the actuators get in a control step.

    Args:
        commands: Before the step.
        control: Decided for the step.
        delay_steps: After so many steps it is there, 0 to the most.
    """
    return _with(commands, control)[delay_steps]


def sent(commands: Commands, control: Float[jax.Array, "actuators"]) -> Commands:
    """Returns the commands after a control step for which something was decided."""
    return _with(commands, control)[:-1]


def _with(commands: Commands, control: Float[jax.Array, "actuators"]) -> Float[jax.Array, "commands actuators"]:
    return jnp.concatenate([control[None].astype(commands.dtype), commands])


class HostCommands:
    """The commands of all lanes of an engine on the host."""

    def __init__(self, rest_control: Float[np.ndarray, "actuators"], delays: Sequence[int]) -> None:
        """Begins with nothing decided.

        Args:
            rest_control: What actuators get until then.
            delays: Of each lane, in control steps.
        """
        self._lanes, self._delays = np.arange(len(delays)), np.array(delays)
        self._sent = np.tile(rest_control, (len(delays), MOST_DELAY_STEPS, 1))

    def deliver(self, controls: Float[np.ndarray, "lanes actuators"]) -> Float[np.ndarray, "lanes actuators"]:
        """Returns what the actuators get in a control step for which controls were decided."""
        known = np.concatenate([controls[:, None], self._sent], axis=1)
        self._sent = known[:, :-1]
        return known[self._lanes, self._delays]
