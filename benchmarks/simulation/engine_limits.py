"""Where a control step of the planar engine spends its time, and what of the machine's limits each part reaches.

    .venv/bin/python benchmarks/simulation/engine_limits.py [--obstacles N ...] [--lanes N] [--document PATH]

Each part is a program of its own for one device, as many lanes as one device gets of 256; its floating point operations
and its bytes are those that XLA counts for a control step (a loop's body once, however often it runs). The limits are
measured on one core in the same process: additions and products of vectors that stay in registers, and a pass over
arrays larger than the caches. Processor time, so that a busy machine changes shares little.
"""

import argparse
import functools
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=1"

from tasks.simulate.devices import prepare_devices

prepare_devices()

import jax  # noqa: E402 - JAX reads its settings when it is imported
import jax.numpy as jnp  # noqa: E402

from benchmarks.simulation.engine_variants import PHYSICS_STEPS, Ours  # noqa: E402
from benchmarks.tables import markdown, with_tables  # noqa: E402
from tasks.simulate.engines.planar.disc_contact import window  # noqa: E402
from tasks.simulate.engines.pytree_schema import unflatten_state  # noqa: E402
from tasks.simulate.geometry.lidar_scan import scan_ranges  # noqa: E402
from tasks.simulate.lane.control_step import (  # noqa: E402
    Mechanics,
    advance_lane,
    decide,
    finish_step,
)
from tasks.simulate.plan.chunks import SLICE_STEPS  # noqa: E402
from tasks.simulate.sensors.lidar import ray_angles  # noqa: E402

LANES, OBSTACLES, TURNS, WARM_STEPS = 128, (25, 100, 400), 7, 500
WINDOW, FEWEST = 6, 7
_VECTORS, _ROUNDS, _COPIED = 64, 20_000, 1 << 25
# Each part reads what the last control step left, by so little that nothing moves: otherwise a loop would do it once.
_HARDLY = 1e-9


class Part(NamedTuple):
    """A part of a control step: processor microseconds, operations and bytes of one lane."""

    cpu_us: float
    flops: float
    bytes: float


class Limits(NamedTuple):
    """What one core does at most: thousand million operations, and bytes moved, a second."""

    gflops: float
    gbytes: float


def parts(lanes: int, obstacles: int) -> dict[str, Part]:
    """Returns the parts of a control step by name, after some seconds of driving about."""
    ours = Ours("planar", lanes, obstacles)
    ours.run(WARM_STEPS)
    program, inputs, kept = ours.under_way()
    mechanics, applications = program.mechanics, program.applications
    state = jax.vmap(functools.partial(unflatten_state, applications))(inputs, kept)
    angles, lidar = ray_angles(applications.lidar), applications.lidar
    decided = jax.vmap(functools.partial(decide, applications))(inputs, state)
    moved = jax.vmap(mechanics.drive)(inputs, state.body, decided.control)

    def rays(given: Any, lane: Any) -> tuple[Any, Any]:  # noqa: ANN401
        seen = scan_ranges(given.seen, lane.body.qpos, angles, lidar.range_m)
        return nudged(lane, seen[0]), seen

    def choice(given: Any, lane: Any) -> tuple[Any, Any]:  # noqa: ANN401
        near = window(given.boxes, given.cylinders, lane.body.qpos[:2], WINDOW, given.near)
        return nudged(lane, sum(jnp.stack([each.x, each.y, each.height]) for each in near)), near[0].x

    def physics(given: Any, lane: Any) -> tuple[Any, Any]:  # noqa: ANN401
        fewest = given._replace(boxes=given.boxes[: FEWEST - 1], cylinders=given.cylinders[:1])
        motion = mechanics.drive(fewest, lane.body, lane.body.qvel)
        return lane._replace(body=motion.body), motion.work

    def rest(given: Any, lane: Any) -> tuple[Any, Any]:  # noqa: ANN401
        episode, decision, motion = lane
        after, record = finish_step(applications, given, episode, decision, motion)
        return (after, decision, motion), record

    around = inputs._replace(near=jax.vmap(mechanics.near)(inputs, state.body))
    share = picked(mechanics, inputs, state, lanes)
    step = measured(functools.partial(advance_lane, mechanics, applications), around, state, lanes)
    return {
        "whole control step": Part(*map(sum, zip(step, share, strict=True))),
        "rays": measured(rays, inputs, state, lanes),
        "window": measured(choice, around, state, lanes),
        "neighbours, once a slice": share,
        f"{PHYSICS_STEPS} physics steps": measured(physics, inputs, state, lanes),
        "scenario, sums, records": measured(rest, inputs, (state, decided, moved), lanes),
    }


def picked(mechanics: Mechanics, inputs: Any, state: Any, lanes: int) -> Part:  # noqa: ANN401 - lanes' inputs and states
    """Returns a control step's share of what is done once a slice: to pick out the obstacles around a robot."""

    def picks(given: Any, lane: Any) -> tuple[Any, Any]:  # noqa: ANN401
        near = mechanics.near(given, lane.body)
        return nudged(lane, near.columns[0, 0]), near.columns

    return Part(*(each / SLICE_STEPS for each in measured(picks, inputs, state, lanes)))


def nudged(lane: Any, by: Any) -> Any:  # noqa: ANN401 - a lane's state
    """Returns a lane whose robot stands a hair's breadth off."""
    return lane._replace(body=lane.body._replace(qpos=lane.body.qpos + _HARDLY * by))


def measured(body: Callable[[Any, Any], tuple[Any, Any]], inputs: Any, state: Any, lanes: int) -> Part:  # noqa: ANN401
    """Returns a part, mapped over lanes and repeated for a slice of control steps."""

    def slice_of_steps(inputs: Any, state: Any) -> Any:  # noqa: ANN401
        return jax.lax.scan(lambda lane, _: jax.vmap(body)(inputs, lane), state, None, length=SLICE_STEPS)

    program = jax.jit(slice_of_steps).lower(inputs, state).compile()
    cpu_s = timed(lambda: program(inputs, state))
    counted = program.cost_analysis() or {}
    return Part(
        cpu_us=cpu_s / SLICE_STEPS / lanes * 1e6,
        flops=counted.get("flops", 0.0) / lanes,
        bytes=counted.get("bytes accessed", 0.0) / lanes,
    )


def timed(run: Callable[[], Any]) -> float:
    """Returns the median processor seconds of a call."""
    jax.block_until_ready(run())
    found: list[float] = []
    for _ in range(TURNS):
        begin_s = time.process_time()
        jax.block_until_ready(run())
        found.append(time.process_time() - begin_s)
    return median(found)


def limits() -> Limits:
    """Returns what one core does at most, in programs compiled as the engines' are."""

    def multiplied(vectors: jax.Array) -> jax.Array:
        return jax.lax.fori_loop(0, _ROUNDS, lambda _, each: functools.reduce(_add_product, range(16), each), vectors)

    vectors, large = jnp.full((_VECTORS,), 0.5), jnp.zeros(_COPIED)
    multiply, copy = jax.jit(multiplied), jax.jit(lambda array: array + 1.0)
    return Limits(
        gflops=2 * 16 * _ROUNDS * _VECTORS / timed(lambda: multiply(vectors)) / 1e9,
        gbytes=2 * large.nbytes / timed(lambda: copy(large)) / 1e9,
    )


def _add_product(each: jax.Array, _: int) -> jax.Array:
    return each * 0.999 + 0.001


def rows(found: Mapping[int, Mapping[str, Part]], most: Limits) -> list[list[str]]:
    """Returns a table: each part's time, what it does of operations and bytes, and their shares of the limits."""
    head = ["part", "obstacles", "CPU us", "flops", "KiB", "GFLOP/s", "GB/s", "of the limits"]
    table = [head]
    for obstacles, each in found.items():
        for name, part in each.items():
            gflops, gbytes = (amount / part.cpu_us / 1e3 for amount in (part.flops, part.bytes))
            share = f"{gflops / most.gflops:.0%}, {gbytes / most.gbytes:.0%}"
            sizes = f"{part.cpu_us:.2f}", f"{part.flops:,.0f}", f"{part.bytes / 1024:,.1f}"
            table.append([name, str(obstacles), *sizes, f"{gflops:.2f}", f"{gbytes:.1f}", share])
    table.append(["one core at most", "", "", "", "", f"{most.gflops:.2f}", f"{most.gbytes:.1f}", ""])
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table, and puts it into a document."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--obstacles", type=int, nargs="+", default=list(OBSTACLES))
    parser.add_argument("--lanes", type=int, default=LANES)
    parser.add_argument("--document", type=Path)
    options = parser.parse_args(arguments)
    table = markdown(rows({count: parts(options.lanes, count) for count in options.obstacles}, limits()))
    print(table)
    if options.document:
        options.document.write_text(with_tables(options.document.read_text(), "limits planar", table))


if __name__ == "__main__":
    main()
