"""Checks a program's applications before lanes of a form run: once for each form and each set of numbers, on a machine.

To trace them takes a third of a second, and says the same each time.
"""

import weakref

import jax
import jax.numpy as jnp
import numpy as np

from tasks.simulate.engine.program import Program
from tasks.simulate.lane.calls import Applications, check_robot, check_scenario
from tasks.simulate.lane.lane_state import LaneInputs
from tasks.simulate.lane.staging import Lane, stack_lanes

_sound: "weakref.WeakKeyDictionary[Applications, set[object]]" = weakref.WeakKeyDictionary()


def check_applications(program: Program, lane: Lane) -> None:
    """Traces a program's applications with what they get of a lane, unless they were with such a one.

    Raises:
        BundleCrash: They raise, or answer what they must not.
    """
    one: LaneInputs = jax.tree.map(
        lambda array: jnp.asarray(array[0]), stack_lanes([lane], program.applications.names, 1)
    )
    forms = tuple((array.shape, str(array.dtype)) for array in (one.floor.clearance_m, one.goals_m, *one.given))
    known, key = _sound.setdefault(program.applications, set()), (forms, np.asarray(one.numbers).tobytes())
    if key in known:
        return
    shapes, numbers = (one.floor, one.goals_m, one.given), np.asarray(one.numbers).tolist()
    if not program.keeper.passed("applications", shapes, numbers):
        joints = program.body().joints
        check_robot(program.applications, one.floor, one.goals_m, one.numbers, program.actuators, joints=joints)
        check_scenario(program.applications, one.goals_m, one.numbers, one.given)
        program.keeper.note("applications", shapes, numbers)
    known.add(key)
