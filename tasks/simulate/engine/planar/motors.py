"""What actuators do to a planar base: their forces, their activations, and how the forces change with velocity.

Formulas: MuJoCo documentation, chapter Computation, "Actuation model" and, for the slopes, "Numerical integration".
"""

import math
from typing import NamedTuple

import jax.numpy as jnp

from tasks.simulate.engine.planar.algebra import Moving, Planar, Scalar, dot, plus
from tasks.simulate.engine.planar.parts import Motor, PlanarRobot


class Push(NamedTuple):
    """What the actuators do in a physics step.

    Attributes:
        force: Along the joints.
        slopes: Each motor's moment and the change of its force with its speed; none unless the integrator asks.
        activations: After the step.
        power_w: What the motors spend, each by itself: a sum over axes would depend on where the axes point.
    """

    force: Planar
    slopes: list[tuple[Planar, Scalar]]
    activations: list[Scalar]
    power_w: Scalar


def push(robot: PlanarRobot, controls: list[Scalar], activations: list[Scalar], moving: Moving) -> Push:
    """Returns what the actuators do to a robot.

    Args:
        robot: With its motors.
        controls: One for each motor.
        activations: Of the motors that have one.
        moving: How the robot stands and moves.
    """
    after = list(activations)
    power_w = jnp.zeros_like(moving.cos)
    total = Planar(*[jnp.zeros_like(moving.cos)] * 3)
    slopes: list[tuple[Planar, Scalar]] = []
    for motor, control in zip(robot.motors, controls, strict=True):
        drive = _limited(control, motor.control_range)
        if motor.activation is not None:
            before = activations[motor.activation]
            after[motor.activation] = _next_activation(motor, drive, before, robot.step_s)
            drive = after[motor.activation] if motor.early else before
        moment = _moment(motor, moving)
        length, speed = dot(_constant(motor.length, moving), moving.place), dot(moment, moving.rate)
        force = _affine(motor.gain, length, speed) * drive + _affine(motor.bias, length, speed)
        if robot.implicit_motors:
            slopes.append((moment, _slope(motor, force, drive)))
        force = _limited(force, motor.force_range)
        power_w = power_w + jnp.abs(force * speed)
        total = plus(total, moment, force)
    limited = Planar(*[_limited(each, limits) for each, limits in zip(total, robot.joint_force_ranges, strict=True)])
    return Push(limited, slopes, after, power_w)


def _moment(motor: Motor, moving: Moving) -> Planar:
    """Returns the forces along the joints that a motor's force of 1 makes."""
    unturned = _constant(motor.moment, moving)
    return Planar(*moving.turned(unturned.x, unturned.y), unturned.yaw) if motor.turns else unturned


def _constant(vector: tuple[float, float, float], moving: Moving) -> Planar:
    return Planar(*(jnp.full_like(moving.cos, each) for each in vector))


def _next_activation(motor: Motor, drive: Scalar, before: Scalar, step_s: float) -> Scalar:
    """Returns the activation of an integrator, or of a filter, a step later."""
    if motor.time_constant_s is None:
        after = before + step_s * drive
    else:
        lag_s = max(motor.time_constant_s, 1e-15)
        share = -math.expm1(-step_s / lag_s) if motor.exact_filter else step_s / lag_s
        after = before + share * (drive - before)
    return _limited(after, motor.activation_range)


def _slope(motor: Motor, force: Scalar, drive: Scalar) -> Scalar:
    """Returns how a motor's force changes with its speed; not at all where its range holds it."""
    slope = motor.gain[2] * drive + motor.bias[2]
    if motor.force_range is None:
        return slope
    low, high = motor.force_range
    return jnp.where((force <= low) | (force >= high), 0.0, slope)


def _affine(coefficients: tuple[float, float, float], length: Scalar, speed: Scalar) -> Scalar:
    constant, per_length, per_speed = coefficients
    total = jnp.full_like(speed, constant)
    total = total + per_length * length if per_length else total
    return total + per_speed * speed if per_speed else total


def _limited(value: Scalar, limits: tuple[float, float] | None) -> Scalar:
    return value if limits is None else jnp.clip(value, *limits)
