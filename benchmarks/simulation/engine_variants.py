"""The same closed loop, several ways: what a user would write with MuJoCo's Python package, and Simyard's engines.

Every variant has the same robot, the same controller, 32 rays at 20 Hz and physics at 200 Hz.
"""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.rollout import Rollout

from benchmarks.applications.explorer.explorer.reactive import Lidar, control
from benchmarks.simulation.engine_worlds import FOLDERS, ROBOT_FILE, as_prisms, bench_world, explorations, starts
from specs.data.episode import CONTROL_S, EpisodeRequest
from specs.data.people import People
from specs.data.world import World
from tasks.simulate.chunk.chunk_simulation import ready_chunk
from tasks.simulate.engines.compiled_program import CompiledProgram, CompiledRun
from tasks.simulate.engines.mjx.mjx_robot import mjx
from tasks.simulate.engines.mujoco.world_stepper import host_robot, world_model
from tasks.simulate.lane.control_step import LaneInputs, LaneState
from tasks.simulate.plan.chunks import SLICE_STEPS

WORLDS = 16
PHYSICS_STEPS = 10
_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
_FOREVER_S = 1e7


class Variant(Protocol):
    """A way to run the closed loop."""

    lanes: int

    def run(self, control_steps: int) -> int:
        """Returns how many control steps were run, at least those asked for."""
        ...


class SliceTimes(NamedTuple):
    """Seconds that slices of all lanes take: the first one with all that comes before it, and the median of others."""

    first_s: float
    slice_s: float


def slice_times(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    folders: Mapping[str, Path],
    *,
    engine: str,
    turns: int,
) -> SliceTimes:
    """Returns what slices of episodes take, a lane for each.

    Raises:
        RuntimeError: They do not start.
    """
    begun = time.perf_counter()
    chunk = ready_chunk(requests, worlds, folders, lanes=len(requests), engine=engine)
    if chunk.run is None:
        raise RuntimeError(f"{engine}: {chunk.rows[0].failure_reason}")
    state, _ = chunk.run.advance(chunk.run.begin())
    jax.block_until_ready(state.body)
    first_s, found = time.perf_counter() - begun, list[float]()
    for _ in range(turns):
        begun = time.perf_counter()
        state, _ = chunk.run.advance(state)
        jax.block_until_ready(state.body)
        found.append(time.perf_counter() - begun)
    return SliceTimes(first_s, median(found))


class Ours:
    """One of Simyard's engines, as a batch runs it."""

    def __init__(
        self,
        engine: str,
        lanes: int,
        obstacles: int,
        people: People | None = None,
        *,
        prisms: bool = False,
        robots: int = 1,
    ) -> None:
        made = ((f"bench/{k}", bench_world(k, obstacles)) for k in range(WORLDS))
        worlds = {name: as_prisms(world) if prisms else world for name, world in made}
        alone, lanes = explorations(lanes // robots, WORLDS, _FOREVER_S), lanes // robots * robots
        shared = {"people": people, "robots": robots if robots > 1 else None}
        requests = [
            each.model_copy(update={**shared, "index": each.index * robots + number, "number": number})
            for each in alone
            for number in range(robots)
        ]
        chunk = ready_chunk(requests, worlds, FOLDERS, lanes=lanes, engine=engine)
        run = chunk.run
        if run is None:
            raise RuntimeError(f"{engine}: {chunk.rows[0].failure_reason}")
        self.lanes, self._run, self._state = lanes, run, run.begin()

    def under_way(self) -> tuple[CompiledProgram, LaneInputs, LaneState]:
        """Returns the program of a JAX engine, what its lanes are given, and where they are.

        Raises:
            TypeError: The engine is another.
        """
        if not isinstance(self._run, CompiledRun):
            raise TypeError("only engines of JAX have one program for all")
        return self._run.program, self._run.inputs, self._state

    def run(self, control_steps: int) -> int:
        """Advances whole slices."""
        slices = -(-control_steps // SLICE_STEPS)
        for _ in range(slices):
            self._state, _ = self._run.advance(self._state)
        jax.block_until_ready(self._state.body)
        return slices * SLICE_STEPS


class _Rays:
    """32 rays a lane by ``mj_multiRay``; what they hit stands still, so each thread needs one state a world."""

    def __init__(self, models: Sequence[mujoco.MjModel], threads: int) -> None:
        self._models, self._base = models, int(models[0].jnt_bodyid[0])
        self._datas = [[mujoco.MjData(model) for model in models] for _ in range(threads)]
        for model, data in ((model, each[k]) for each in self._datas for k, model in enumerate(models)):
            mujoco.mj_forward(model, data)
        self._angles = 2 * np.pi * np.arange(Lidar().rays) / Lidar().rays

    def scan(self, thread: int, poses: np.ndarray, ranges_m: np.ndarray, lanes: Sequence[int]) -> None:
        """Fills in the ranges of some lanes."""
        lidar = Lidar()
        geoms, distances, directions = np.empty(lidar.rays, np.int32), np.empty(lidar.rays), np.zeros((lidar.rays, 3))
        for lane in lanes:
            angles, world = poses[lane, 2] + self._angles, lane % len(self._models)
            directions[:, 0], directions[:, 1] = np.cos(angles), np.sin(angles)
            eye = np.array([poses[lane, 0], poses[lane, 1], lidar.height_m])
            data = self._datas[thread][world]
            mujoco.mj_multiRay(
                self._models[world],
                data,
                eye,
                directions.ravel(),
                None,
                1,
                self._base,
                geoms,
                distances,
                None,
                lidar.rays,
                lidar.range_m,
            )
            ranges_m[lane] = np.where(distances < 0.0, lidar.range_m, np.minimum(distances, lidar.range_m))


class StepLoop:
    """``mj_step`` and ``mj_multiRay`` in a Python loop over the lanes, on one core."""

    def __init__(self, lanes: int, obstacles: int) -> None:
        self.lanes, self._time_s = lanes, 0.0
        models = _models(obstacles)
        self._models = [models[lane % WORLDS] for lane in range(lanes)]
        self._datas = [mujoco.MjData(model) for model in self._models]
        self._poses, self._ranges_m = starts(lanes), np.empty((lanes, Lidar().rays))
        for data, start in zip(self._datas, self._poses, strict=True):
            data.qpos[:] = start
        self._rays = _Rays(models, 1)

    def run(self, control_steps: int) -> int:
        """Steps lane by lane."""
        for _ in range(control_steps):
            self._rays.scan(0, self._poses, self._ranges_m, range(self.lanes))
            controls = control(self._poses, self._ranges_m, self._time_s, np)
            for lane, (model, data) in enumerate(zip(self._models, self._datas, strict=True)):
                data.ctrl[:] = controls[lane]
                mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
                self._poses[lane] = data.qpos
            self._time_s += CONTROL_S
        return control_steps


class RolloutLoop:
    """``mujoco.rollout`` over all lanes, and ``mj_multiRay`` in as many threads."""

    def __init__(self, lanes: int, obstacles: int, threads: int) -> None:
        self.lanes, self._time_s, self._threads = lanes, 0.0, threads
        models = _models(obstacles)
        self._models = [models[lane % WORLDS] for lane in range(lanes)]
        self._rays, self._rollout, self._pool = _Rays(models, threads), Rollout(nthread=threads), _pool(threads)
        self._datas = [mujoco.MjData(models[0]) for _ in range(threads)]
        self._states = np.zeros((lanes, mujoco.mj_stateSize(models[0], _STATE)))
        self._states[:, 1:4] = starts(lanes)
        self._warmstarts, self._ranges_m = np.zeros((lanes, 3)), np.empty((lanes, Lidar().rays))
        self._path = np.empty((lanes, PHYSICS_STEPS, self._states.shape[1]))
        self._sensed = np.empty((lanes, PHYSICS_STEPS, models[0].nsensordata))

    def run(self, control_steps: int) -> int:
        """Scans, decides and rolls out all lanes at once."""
        shares = [range(thread, self.lanes, self._threads) for thread in range(self._threads)]
        for _ in range(control_steps):
            poses = self._states[:, 1:4]
            list(
                self._pool.map(
                    lambda job: self._rays.scan(job[0], poses, self._ranges_m, job[1]),  # noqa: B023 - done before the next
                    enumerate(shares),
                )
            )
            controls = control(poses, self._ranges_m, self._time_s, np)
            self._rollout.rollout(
                self._models,
                self._datas,
                self._states,
                np.repeat(controls[:, None], PHYSICS_STEPS, axis=1),
                control_spec=_CONTROL,
                skip_checks=True,
                nstep=PHYSICS_STEPS,
                initial_warmstart=self._warmstarts,
                state=self._path,
                sensordata=self._sensed,
            )
            self._states = self._path[:, -1].copy()
            self._time_s += CONTROL_S
        return control_steps


class BatchLoop:
    """``mujoco.batch``: all lanes stepped and their rays cast by one call each."""

    def __init__(self, lanes: int, obstacles: int, threads: int) -> None:
        self.lanes, self._time_s = lanes, 0.0
        models = _models(obstacles)
        self._batch = Batch(models[0], lanes, threads)
        self._batch.set_models([models[lane % WORLDS] for lane in range(lanes)])
        self._poses, self._controls = self._batch.bind("qpos"), self._batch.bind("ctrl")
        self._poses[:] = starts(lanes)
        self._base = int(models[0].jnt_bodyid[0])
        self._angles = 2 * np.pi * np.arange(Lidar().rays) / Lidar().rays

    def run(self, control_steps: int) -> int:
        """Scans, decides and steps all lanes at once."""
        for _ in range(control_steps):
            self._controls[:] = control(self._poses, self._scan(), self._time_s, np)
            self._batch.step(nstep=PHYSICS_STEPS)
            self._time_s += CONTROL_S
        return control_steps

    def _scan(self) -> np.ndarray:
        lidar, angles = Lidar(), self._poses[:, 2:] + self._angles
        ways = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
        eyes = np.insert(self._poses[:, :2], 2, lidar.height_m, axis=1)[:, None]
        distances = self._batch.ray(eyes, ways, bodyexclude=self._base)[0]
        return np.where(distances < 0.0, lidar.range_m, np.minimum(distances, lidar.range_m))


class StockMjx:
    """MJX with all obstacles as geoms and its own rays; one world, cylinders as capsules (MJX has no rays for them)."""

    def __init__(self, lanes: int, obstacles: int) -> None:
        self.lanes = lanes
        spec = host_robot(ROBOT_FILE).spec.copy()
        spec.add_material(name="none")  # without one, MJX's rays fail
        for solid in bench_world(0, obstacles).walls:
            box, (x, y, z) = solid.shape == "box", solid.half_extents_m
            kind = mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_CAPSULE
            geom = spec.worldbody.add_geom(name=solid.name, type=kind, condim=1)
            geom.pos, geom.size = solid.center_m, [x, y, z] if box else [x, z, 0.0]
            geom.quat = [np.cos(solid.yaw_rad / 2), 0.0, 0.0, np.sin(solid.yaw_rad / 2)]
        host = spec.compile()
        self._model, self._base = mjx.put_model(host), int(host.jnt_bodyid[0])
        data = mjx.make_data(self._model)
        self._state = jax.vmap(lambda start: data.replace(qpos=start))(jnp.asarray(starts(lanes), jnp.float32))
        self._step = jax.jit(jax.vmap(self._control_step))

    def _control_step(self, data: mjx.Data) -> mjx.Data:
        lidar = Lidar()
        data = mjx.forward(self._model, data)
        angles = data.qpos[2] + jnp.asarray(2 * np.pi * np.arange(lidar.rays) / lidar.rays, jnp.float32)
        directions = jnp.stack([jnp.cos(angles), jnp.sin(angles), jnp.zeros(lidar.rays)], axis=-1)
        eye = jnp.array([data.qpos[0], data.qpos[1], lidar.height_m])
        cast = jax.vmap(lambda way: mjx.ray(self._model, data, eye, way, (), True, self._base)[0])  # noqa: FBT003 - MJX's
        ranges = cast(directions)
        ranges = jnp.where(ranges < 0.0, lidar.range_m, jnp.minimum(ranges, lidar.range_m))
        data = data.replace(ctrl=control(data.qpos, ranges, data.time, jnp))
        return jax.lax.fori_loop(0, PHYSICS_STEPS, lambda _, each: mjx.step(self._model, each), data)

    def run(self, control_steps: int) -> int:
        """Steps all lanes."""
        for _ in range(control_steps):
            self._state = self._step(self._state)
        jax.block_until_ready(self._state.qpos)
        return control_steps


def _models(obstacles: int) -> list[mujoco.MjModel]:
    """Returns the robot in each world as a user would compile it: without the sensors that only Simyard needs."""
    robot = host_robot(ROBOT_FILE)
    models = [world_model(robot, bench_world(k, obstacles)) for k in range(WORLDS)]
    for model in models:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    return models


def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)
