"""What messages call the parts of a robot: by their names, or by where an author finds them in ``robot.xml``."""

from collections.abc import Sequence

import mujoco
import numpy as np

_ENDINGS = {1: "st", 2: "nd", 3: "rd"}
_TEENS = (11, 12, 13)


def body_label(model: mujoco.MjModel, body: int) -> str:
    """Returns ``body 'base'``, or ``the 2nd body in body 'base'``."""
    if name := model.body(body).name:
        return f"body {name!r}"
    parent = int(model.body_parentid[body])
    siblings = [each for each in range(1, model.nbody) if model.body_parentid[each] == parent]
    return f"the {_place(siblings, body)} body in {body_label(model, parent) if parent else 'the world'}"


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """Returns ``geom 'hull'``, or ``the 2nd geom (box) of body 'base'``, as they follow each other in the file."""
    if name := model.geom(geom).name:
        return f"geom {name!r}"
    kind, body = word_of(mujoco.mjtGeom(model.geom_type[geom]), "mjGEOM_"), int(model.geom_bodyid[geom])
    siblings = np.flatnonzero(model.geom_bodyid == body).tolist()
    return f"the {_place(siblings, geom)} geom ({kind}) of {body_label(model, body)}"


def joint_label(model: mujoco.MjModel, joint: int) -> str:
    """Returns ``joint 'x'``, or ``the 2nd joint (slide) of body 'base'``."""
    if name := model.joint(joint).name:
        return f"joint {name!r}"
    kind, body = word_of(mujoco.mjtJoint(model.jnt_type[joint]), "mjJNT_"), int(model.jnt_bodyid[joint])
    siblings = np.flatnonzero(model.jnt_bodyid == body).tolist()
    return f"the {_place(siblings, joint)} joint ({kind}) of {body_label(model, body)}"


def actuator_label(model: mujoco.MjModel, number: int) -> str:
    """Returns ``actuator 'forward'``, or ``the 2nd actuator``."""
    if name := model.actuator(number).name:
        return f"actuator {name!r}"
    return f"the {_place(range(model.nactuator), number)} actuator"


def word_of(member: object, prefix: str) -> str:
    """Returns what MJCF calls a member of one of MuJoCo's enumerations, such as ``box`` for ``mjGEOM_BOX``."""
    return str(getattr(member, "name", member)).removeprefix(prefix).lower()


def _place(siblings: Sequence[int], one: int) -> str:
    number = list(siblings).index(one) + 1
    return f"{number}{'th' if number % 100 in _TEENS else _ENDINGS.get(number % 10, 'th')}"
