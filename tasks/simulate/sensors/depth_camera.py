"""The depth camera: pictures of the distances ahead, at a rate of their own, some control steps old, with noise.

Pictures are kept from the control step at which they were taken to the one at which the next is there.
"""

import functools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int

from specs.bundle_files import DepthCameraDeclaration
from tasks.simulate.application.contract import Body
from tasks.simulate.devices import device_kind
from tasks.simulate.geometry.depth_picture import DepthScene, Eye, Picture, View, depth_picture
from tasks.simulate.geometry.hull_picture import Mount, hull_picture
from tasks.simulate.geometry.lidar_scan import lanes_in_front
from tasks.simulate.sensors.sensor import (
    Drive,
    Fields,
    Memory,
    Pace,
    Scalar,
    Seed,
    Sensor,
    Situation,
    is_set,
    pace_of,
    rotate,
    step_key,
)

_NOISE, _DROPOUT, _EDGE_DROPOUT = 3, 4, 5
# Of cameras behind the first one of a list: each begins with a seed of its own.
_OTHERS = 64
_ERRORS = ("sigma_m_per_m2", "baseline_m", "disparity_px", "dropout", "edge_dropout", "edge_share")


class DepthCamera(NamedTuple):
    """A depth camera; fields as in ``DepthCameraDeclaration``."""

    columns: int
    rows: int
    fov_rad: float
    range_m: float
    z_m: Scalar
    x_m: Scalar = 0.0
    y_m: Scalar = 0.0
    pitch_rad: float = 0.0
    yaw_rad: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0
    sigma_m_per_m2: Scalar = 0.0
    baseline_m: Scalar = 0.0
    disparity_px: Scalar = 0.0
    dropout: Scalar = 0.0
    edge_dropout: Scalar = 0.0
    edge_share: Scalar = 0.1
    sees_robot: int = 0
    name: str = ""
    others: tuple["DepthCamera", ...] = ()

    @property
    def every(self) -> tuple["DepthCamera", ...]:
        """Returns it and those behind it in a list of cameras, whose pictures are as large."""
        return self, *self.others

    @property
    def shape(self) -> tuple[int, ...]:
        """Returns the shape of what it shows: rows and columns, after the number of cameras of a list."""
        return (*([len(self.every)] if self.others else []), self.rows, self.columns)

    @property
    def view(self) -> View:
        """Returns its picture, which all lanes share."""
        return View(self.columns, self.rows, self.fov_rad, self.pitch_rad, self.range_m)

    @property
    def pace(self) -> Pace:
        """Returns when it takes pictures."""
        return pace_of(self)

    @property
    def declared(self) -> DepthCameraDeclaration:
        """Returns the declaration of a camera in plain numbers."""
        of_list = {"others": [each.declared.model_dump() for each in self.others]}
        return DepthCameraDeclaration.model_validate(self._asdict() | of_list)


def seen_hull_m(camera: DepthCamera | None, robot: Path) -> Float32[np.ndarray, "*cameras rows columns"] | None:
    """Returns what a camera, in plain numbers, sees of its own robot, or each of a list; None if that is nothing.

    Raises:
        RobotRefused: No engine takes the robot.
    """
    if camera is None or not any(each.sees_robot for each in camera.every):
        return None
    if camera.others:
        alone = [seen_hull_m(each._replace(others=()), robot) for each in camera.every]
        return np.stack([np.full(camera.shape[1:], np.inf, np.float32) if each is None else each for each in alone])
    mount = Mount(*map(float, (camera.x_m, camera.y_m, camera.z_m, camera.yaw_rad)))
    return hull_picture(robot, camera.view, mount)


class _Shot(NamedTuple):
    """One lane at the end of a control step.

    Attributes:
        due: Whether a picture is taken.
        slot: Where it is kept.
        pictures: All that are kept.
        errors: The camera's numbers that may be other than 0, by name.
        step: Which control step comes.
        hull_depth_m: What is seen of the robot itself; None if that is nothing.
    """

    due: Bool[Array, ""]
    slot: Int[Array, ""]
    pictures: Float[Array, "slots rows columns"]
    scene: DepthScene
    eye: Eye
    errors: dict[str, Array]
    seed: Seed
    step: Int[Array, ""]
    hull_depth_m: Picture | None


def noisy_depths(depth_m: Picture, view: View, errors: dict[str, Any], seed: Seed, step: Int[Array, ""]) -> Picture:
    """Returns depths as a camera reports them: noise, then steps, then what is lost; what sees nothing stays so.

    Args:
        depth_m: True ones.
        view: Its picture.
        errors: How it errs, by name; what is missing is 0.
        seed: The episode's.
        step: At which control step the picture is taken; each has its own errors.
    """
    noisy = depth_m
    if "sigma_m_per_m2" in errors:
        drawn = jax.random.normal(step_key(seed, _NOISE, step), depth_m.shape, depth_m.dtype)
        noisy = noisy + errors["sigma_m_per_m2"] * depth_m**2 * drawn
    if "baseline_m" in errors and "disparity_px" in errors:
        # Stereo: a depth z is a disparity of focal length * baseline / z pixels, which comes in whole steps.
        far_m = view.focal_px * errors["baseline_m"] / errors["disparity_px"]
        steps = jnp.maximum(jnp.round(far_m / jnp.maximum(noisy, 1e-6)), 1.0)
        noisy = jnp.where(errors["baseline_m"] * errors["disparity_px"] > 0.0, far_m / steps, noisy)
    noisy = jnp.clip(noisy, 0.0, view.range_m) if noisy is not depth_m else noisy
    for name, stream in (("dropout", _DROPOUT), ("edge_dropout", _EDGE_DROPOUT)):
        if name in errors:
            lost = jax.random.uniform(step_key(seed, stream, step), depth_m.shape) < errors[name]
            at = _edges(depth_m, errors.get("edge_share", 0.0)) if name == "edge_dropout" else True
            noisy = jnp.where(lost & at, view.range_m, noisy)
    return jnp.where(depth_m < view.range_m, noisy, depth_m)


def _edges(depth_m: Picture, share: Scalar) -> Bool[Array, "rows columns"]:
    """Returns which pixels have one beside, above or below that is nearer or farther by more than a share of theirs."""
    most = share * depth_m
    found = jnp.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        jump = jnp.abs(jnp.diff(depth_m, axis=axis))
        none = jnp.zeros_like(jnp.take(depth_m, jnp.arange(1), axis=axis))
        for beside in ((jump, none), (none, jump)):
            found |= jnp.concatenate(beside, axis=axis) > most
    return found


def _picture(view: View, shot: _Shot) -> Picture:
    depth_m = depth_picture(shot.scene, shot.eye, view)
    if shot.hull_depth_m is not None:
        depth_m = jnp.minimum(depth_m, shot.hull_depth_m)
    return noisy_depths(depth_m, view, shot.errors, shot.seed, shot.step)


@functools.cache
def _camera(view: View) -> Callable[[_Shot], Float[Array, "slots rows columns"]]:
    """Returns what gives a lane's pictures with the one that is due, and takes no other."""

    @jax.custom_batching.custom_vmap
    def take(shot: _Shot) -> Array:
        return jax.lax.cond(
            shot.due, lambda: shot.pictures.at[shot.slot].set(_picture(view, shot)), lambda: shot.pictures
        )

    # Mapped as any function, each lane would take a picture at each control step, whichever is due.
    @take.def_vmap
    def _(lanes: int, mapped: Sequence[_Shot], shots: _Shot) -> tuple[Array, bool]:
        every = lanes_in_front(lanes, shots, mapped[0])
        if device_kind() == "gpu":  # which has room for all lanes at once, and waits between one and the next
            fresh = jax.vmap(functools.partial(_picture, view))(every)
            taken = every.pictures.at[jnp.arange(lanes), every.slot].set(fresh)
            return jnp.where(every.due[:, None, None, None], taken, every.pictures), True
        order = jnp.nonzero(every.due, size=lanes, fill_value=0)[0]

        def take_one(place: Array, pictures: Array) -> Array:
            lane = order[place]
            shot = jax.tree.map(lambda array: jax.lax.dynamic_index_in_dim(array, lane, keepdims=False), every)
            return pictures.at[lane, shot.slot].set(_picture(view, shot))

        return jax.lax.fori_loop(0, jnp.count_nonzero(every.due), take_one, every.pictures), True

    return take


def _begin(shared: DepthCamera, own: DepthCamera, start: Situation) -> Memory:
    blank = jnp.full((shared.pace.slots, shared.rows, shared.columns), shared.range_m)
    return _taken(shared, own, (blank,) * len(shared.every) if shared.others else blank, start)


def _feel(shared: DepthCamera, own: DepthCamera, pictures: Memory, drive: Drive) -> Memory:
    return _taken(shared, own, pictures, drive.after)


def _taken(shared: DepthCamera, own: DepthCamera, pictures: Memory, now: Situation) -> Memory:
    if not shared.others:
        return _camera(shared.view)(_shot(shared, own, pictures, now))
    cameras = enumerate(zip(shared.every, own.every, pictures, strict=True))
    return tuple(
        _taken(one._replace(others=()), its, kept, _seen_by(now, place)) for place, (one, its, kept) in cameras
    )


def _seen_by(now: Situation, number: int) -> Situation:
    """Returns a lane as one camera of a list has it: with errors of its own, and what it sees of the robot."""
    hull_m = None if now.hull_depth_m is None else now.hull_depth_m[number]
    seed = jax.random.key_data(step_key(now.seed, _OTHERS, jnp.int32(number))) if number else now.seed
    return now._replace(seed=seed, hull_depth_m=hull_m)


def _shot(shared: DepthCamera, own: DepthCamera, pictures: Array, now: Situation) -> _Shot:
    if now.scene is None:
        raise ValueError("no scene was staged for a robot with a depth camera")
    pose, stride = now.body.qpos, shared.pace.stride
    mount = jnp.stack([jnp.asarray(value, pose.dtype) for value in (own.x_m, own.y_m, own.yaw_rad)])
    x, y, yaw = pose + rotate(mount, pose[2])
    return _Shot(
        due=now.step % stride == 0,
        slot=now.step // stride % shared.pace.slots,
        pictures=pictures,
        scene=now.scene,
        eye=jnp.stack([x, y, jnp.asarray(own.z_m, pose.dtype), yaw]),
        errors={name: jnp.asarray(getattr(own, name), pose.dtype) for name in _ERRORS if is_set(getattr(own, name))},
        seed=now.seed,
        step=now.step,
        hull_depth_m=now.hull_depth_m,
    )


@functools.partial(jax.jit, static_argnums=0)
def pictures_again(  # noqa: PLR0917 - what a lane has, and what a picture has
    camera: DepthCamera,
    scene: DepthScene,
    seed: Seed,
    poses: Float[Array, "pictures 3"],
    steps: Int[Array, "pictures"],
    beside: Float[Array, "pictures cylinders 5"],
    *,
    hull_depth_m: Float[Array, "*cameras rows columns"] | None = None,
    boxes: Float[Array, "pictures boxes 8"] | None = None,
) -> Float[Array, "pictures rows columns"]:
    """Returns the pictures that a robot's camera took, from where the robot was; those of a list one above the other.

    Args:
        camera: The episode's, in plain numbers.
        scene: Of its world.
        seed: The episode's.
        poses: Of the robot.
        steps: At which control steps.
        beside: What moved about then, as the scene's cylinders.
        hull_depth_m: What the camera sees of its own robot; None if that is nothing.
        boxes: What was put there then, as the scene's boxes; None for nothing.
    """

    def again(at: tuple[Array, Array, Array, Array | None]) -> Picture:
        none: Any = None
        body = Body(at[0], none, none, none)
        seen = scene._replace(cylinders=jnp.concatenate([scene.cylinders, at[2]]))
        if at[3] is not None:
            seen = seen._replace(boxes=jnp.concatenate([scene.boxes, at[3]]))
        now = Situation(body, none, seed, at[1], seen, hull_depth_m)
        if not camera.others:
            return _picture(camera.view, _shot(camera, camera, none, now))
        each = [
            _picture(one.view, _shot(one, one, none, _seen_by(now, number))) for number, one in enumerate(camera.every)
        ]
        return jnp.concatenate(each)

    return jax.lax.map(again, (poses, steps, beside, boxes))


def _observe(shared: DepthCamera, _own: DepthCamera, pictures: Memory, now: Situation) -> Fields:
    pace = shared.pace
    taken = (now.step - pace.latency_steps) // pace.stride

    def shown(kept: Array) -> Array:
        return jnp.where(taken >= 0, kept[taken % pace.slots], shared.range_m)

    return {"depth_m": jnp.stack([shown(each) for each in pictures]) if shared.others else shown(pictures)}


def _blank(shared: DepthCamera) -> Fields:
    return {"depth_m": jnp.full(shared.shape, shared.range_m)}


DEPTH_CAMERA = Sensor(
    name="depth_camera",
    kind=DepthCamera,
    absent=None,
    blank=_blank,
    begin=_begin,
    feel=_feel,
    observe=_observe,
    limits={
        "columns": (1, 640),
        "rows": (1, 480),
        "fov_rad": (0.01, 3.0),
        "range_m": (0.01, 1e4),
        "x_m": (-1e4, 1e4),
        "y_m": (-1e4, 1e4),
        "pitch_rad": (-math.pi / 2, math.pi / 2),
        "yaw_rad": (-1e4, 1e4),
        "dropout": (0.0, 1.0),
        "edge_dropout": (0.0, 1.0),
        "edge_share": (0.0, 1.0),
        "sees_robot": (0, 1),
    },
    whole=("columns", "rows", "sees_robot"),
    shared=("columns", "rows", "fov_rad", "range_m", "pitch_rad", "sees_robot"),
    streams=(_NOISE, _DROPOUT, _EDGE_DROPOUT, _OTHERS),
    keeps=True,
)
