"""Many robots, each in its world, stepped by C MuJoCo on the host's threads, in double precision.

``mujoco.rollout`` steps them: measured against a thread pool that calls ``mj_step``, it takes a tenth less time, and
gives each physics step's sensor values, of which impulse and energy are summed up (docs/reference/engines.md).
"""

import contextlib
import logging
from collections.abc import Generator, Sequence
from threading import Lock
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from mujoco.rollout import Rollout

from tasks.simulate.application.coordinates import coordinates_at, pose_of, velocity_of
from tasks.simulate.engine.mujoco.model import HostRobot

logger = logging.getLogger(__name__)
_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_TIME = 1  # comes first in a state, then qpos, qvel and act
_PUSH = 3
# MuJoCo calls numbers beyond this bad and stops stepping (mjMAXVAL).
_MOST = 1e10


class HostBody(NamedTuple):
    """The robots' mechanical states as the applications get them; fields as in ``application.motion.Body``."""

    qpos: Float32[np.ndarray, "lanes 3"]
    qvel: Float32[np.ndarray, "lanes 3"]
    act: Float32[np.ndarray, "lanes activations"]
    joints: tuple[Float32[np.ndarray, "lanes coordinates"], Float32[np.ndarray, "lanes speeds"]] | None


class HostWork(NamedTuple):
    """What a control step's physics did; fields as in ``application.motion.Work``."""

    impulse_ns: Float32[np.ndarray, "lanes"]
    push_ns: Float32[np.ndarray, "lanes 2"]
    energy_j: Float32[np.ndarray, "lanes"]


class Stepper:
    """The robots of a chunk; what one of them does depends neither on the others nor on the number of threads.

    Args:
        robot: What they all are.
        models: Each lane's, all of the same sizes (``mujoco_model.world_models``).
        starts: Each lane's (x m, y m, yaw rad).
        threads: To step them on.
    """

    def __init__(
        self,
        robot: HostRobot,
        models: Sequence[mujoco.MjModel],
        starts: Float[np.ndarray, "lanes 3"],
        threads: int,
    ) -> None:
        self._robot, self._models = robot, list(models)
        self._pool = Rollout(nthread=threads if threads > 1 else 0)
        self._datas = [mujoco.MjData(models[0]) for _ in range(threads)]
        first = models[0]
        self._qpos = slice(_TIME, _TIME + first.nq)
        self._qvel = slice(self._qpos.stop, self._qpos.stop + first.nv)
        self._act = slice(self._qvel.stop, self._qvel.stop + first.na)
        self._states = self._initial(starts.astype(np.float64))
        self._warmstarts = np.zeros((len(models), first.nv))

    def body(self) -> HostBody:
        """Returns all robots as they are."""
        qpos, qvel, base = self._states[:, self._qpos], self._states[:, self._qvel], self._robot.base
        joints = (_single(qpos), _single(qvel)) if base.articulated else None
        pose, velocity = pose_of(base, qpos, np), velocity_of(base, qpos, qvel, np)
        return HostBody(_single(pose), _single(velocity), _single(self._states[:, self._act]), joints)

    def drive(
        self, controls: Float[np.ndarray, "lanes actuators"], moving: Bool[np.ndarray, "lanes"]
    ) -> tuple[HostBody, HostWork]:
        """Returns the robots a control step later, and what was done; those that are not moving stay as they are."""
        chosen = np.flatnonzero(moving)
        work = HostWork(*(np.zeros((len(moving), *shape), np.float32) for shape in ((), (2,), ())))
        if len(chosen):
            path, sensed = self._rolled_out(chosen, controls[chosen].astype(np.float64))
            self._warmstarts[chosen] = self._accelerations(np.concatenate([self._states[chosen, None], path], axis=1))
            self._states[chosen] = path[:, -1]
            # MuJoCo would take a control that it calls bad for 0, and say so in a log.
            self._states[chosen[(np.abs(controls[chosen]) > _MOST).any(axis=1)]] = np.nan
            for total, done in zip(work, self._work(sensed), strict=True):
                total[chosen] = done
        return self.body(), work

    def _initial(self, starts: Float64[np.ndarray, "lanes 3"]) -> Float64[np.ndarray, "lanes state"]:
        model, data = self._models[0], self._datas[0]
        mujoco.mj_resetData(model, data)
        state = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, state, _STATE)
        states = np.tile(state, (len(starts), 1))
        states[:, self._qpos] = coordinates_at(self._robot.base, self._robot.rest, starts, np)
        states[:, self._act] = self._robot.rest_act
        return states

    def _rolled_out(
        self, chosen: Int[np.ndarray, "chosen"], controls: Float64[np.ndarray, "chosen actuators"]
    ) -> tuple[Float64[np.ndarray, "chosen steps state"], Float64[np.ndarray, "chosen steps sensors"]]:
        """Returns the states after each physics step of a control step, and what the sensors read in it."""
        steps = self._robot.physics_steps
        states = np.empty((len(chosen), steps, self._states.shape[1]))
        sensed = np.empty((len(chosen), steps, self._models[0].nsensordata))
        with _no_log():
            self._pool.rollout(
                [self._models[lane] for lane in chosen],
                self._datas,
                self._states[chosen],
                np.repeat(controls[:, None], steps, axis=1),
                control_spec=int(mujoco.mjtState.mjSTATE_CTRL),
                skip_checks=True,
                nstep=steps,
                initial_warmstart=self._warmstarts[chosen],
                state=states,
                sensordata=sensed,
            )
        return states, sensed

    def _accelerations(self, path: Float64[np.ndarray, "chosen states state"]) -> Float64[np.ndarray, "chosen speeds"]:
        """Returns the last step's accelerations, which the solver starts from in the next one."""
        return (path[:, -1, self._qvel] - path[:, -2, self._qvel]) / self._models[0].opt.timestep

    def _work(self, sensed: Float64[np.ndarray, "chosen steps sensors"]) -> HostWork:
        step_s, forces = self._models[0].opt.timestep, self._robot.actuators
        push_n = sensed[:, :, :2]
        powers_w = sensed[:, :, _PUSH : _PUSH + forces] * sensed[:, :, _PUSH + forces :]
        return HostWork(
            _single(np.hypot(push_n[:, :, 0], push_n[:, :, 1]).sum(axis=1) * step_s),
            _single(push_n.sum(axis=1) * step_s),
            _single(np.abs(powers_w).sum(axis=(1, 2)) * step_s),
        )


def _single(values: Float64[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Returns values for the applications; what MuJoCo calls bad is no number."""
    return np.where(np.abs(values) < _MOST, values, np.nan).astype(np.float32)


class _QuietSteps:
    """How many threads step now, while MuJoCo's warnings go to this module's log."""

    turn = Lock()
    threads = 0


@contextlib.contextmanager
def _no_log() -> Generator[None]:
    """Keeps MuJoCo from writing MUJOCO_LOG.TXT into the working directory: a state that blows up is a row."""
    with _QuietSteps.turn:
        _QuietSteps.threads += 1
        mujoco.set_mju_user_warning(logger.debug)
    try:
        yield
    finally:
        with _QuietSteps.turn:
            _QuietSteps.threads -= 1
            if not _QuietSteps.threads:
                mujoco.set_mju_user_warning(None)
