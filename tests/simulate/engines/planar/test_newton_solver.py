"""The solver finds the minimum: there, what acts on the robot, the contacts' push and dry friction are in balance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.engines.planar.disc_contact import Contact, Row
from tasks.simulate.engines.planar.newton_solver import minimizer
from tasks.simulate.engines.planar.planar_algebra import Planar, Symmetric
from tasks.simulate.engines.planar.planar_robot import DryFriction

PROBLEMS = 2000
CONTACTS = 3
DRY = tuple(
    DryFriction(axis, limit, 100.0, weight) for axis, limit, weight in ((0, 2.0, 40.0), (1, 0.5, 40.0), (2, 0.1, 1.0))
)
MASS = np.array([[2.0, 0.0, -0.1], [0.0, 2.5, 0.15], [-0.1, 0.15, 0.05]])


def problems(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Returns contacts in all directions around a robot, half of them not touching, as hard and rough as they come."""
    angle = rng.uniform(-np.pi, np.pi, (PROBLEMS, CONTACTS))
    normal = np.stack([np.cos(angle), np.sin(angle), 0.02 * rng.normal(size=angle.shape)], axis=-1)
    across = np.stack([-np.sin(angle), np.cos(angle), -0.18 * np.ones_like(angle)], axis=-1)
    touching = rng.random(angle.shape) < 0.5
    return {
        "normal": normal,
        "tangent": rng.uniform(0.2, 1.5, (PROBLEMS, 1, 1)) * across,
        "target": rng.normal(0.0, 20.0, (PROBLEMS, CONTACTS, 2)),
        "weight": np.where(touching, 10.0 ** rng.uniform(1.0, 3.0, angle.shape), 0.0),
        "force": rng.normal(0.0, 10.0, (PROBLEMS, 3)) * [1.0, 1.0, 0.1],
        "slip": rng.normal(0.0, 5.0, (PROBLEMS, 3)),
        "start": rng.normal(0.0, 20.0, (PROBLEMS, 3)),
    }


def _row(way: jax.Array, target: jax.Array) -> Row:
    return Row(way[0], way[1], way[2], target)


def found(given: dict[str, np.ndarray], dry: tuple[DryFriction, ...]) -> np.ndarray:
    """Returns the engine's accelerations."""
    xx, xy, xw, yy, yw, ww = (MASS[i, j] for i in range(3) for j in range(i, 3))

    def solve(one: dict[str, jax.Array]) -> jax.Array:
        contacts = [
            Contact(
                _row(one["normal"][k], one["target"][k, 0]),
                [_row(one["tangent"][k], one["target"][k, 1])],
                one["weight"][k],
            )
            for k in range(CONTACTS)
        ]
        mass = Symmetric(*(jnp.full((), each) for each in (xx, xy, xw, yy, yw, ww)))
        slips = [(each, one["slip"][each.axis]) for each in dry]
        return jnp.stack(minimizer(mass, Planar(*one["force"]), contacts, slips, Planar(*one["start"])))

    return np.asarray(jax.jit(jax.vmap(solve))({name: jnp.asarray(each, jnp.float32) for name, each in given.items()}))


def imbalance(given: dict[str, np.ndarray], dry: tuple[DryFriction, ...], at: np.ndarray) -> np.ndarray:
    """Returns how far forces are from balance, as a share of the largest force that takes part."""
    inertia, acting = at @ MASS, given["force"]
    parts = [inertia, -acting]
    for sign in (1.0, -1.0):
        row = given["normal"] + sign * given["tangent"]
        target = given["target"][..., 0] + sign * given["target"][..., 1]
        violation = np.einsum("pcx,px->pc", row, at) - target
        parts.append(np.einsum("pcx,pc->px", row, given["weight"] * np.minimum(violation, 0.0)))
    friction = np.zeros_like(at)
    for each in dry:
        held = each.weight * (at[:, each.axis] - given["slip"][:, each.axis])
        friction[:, each.axis] = np.clip(held, -each.limit, each.limit)
    parts.append(friction)
    scale = np.abs(np.stack(parts)).max(axis=(0, 2)) + 1.0
    return np.abs(np.sum(parts, axis=0)).max(axis=1) / scale


@pytest.mark.parametrize("dry", [(), DRY], ids=["contacts", "contacts and dry friction"])
def test_forces_are_in_balance(dry: tuple[DryFriction, ...]):
    given = problems(np.random.default_rng(11))
    assert imbalance(given, dry, found(given, dry)).max() < 1e-3


def test_full_steps_alone_would_not_get_there(monkeypatch: pytest.MonkeyPatch):
    """Guards the test above: its problems need the search along a step that goes too far."""
    monkeypatch.setattr("tasks.simulate.engines.planar.newton_solver._FULL_STEPS", 1000)
    given = problems(np.random.default_rng(11))
    assert imbalance(given, DRY, found(given, DRY)).max() > 0.01


def test_a_robot_that_nothing_touches_follows_its_forces():
    given = problems(np.random.default_rng(2))
    given["weight"] = np.zeros_like(given["weight"])
    expected = np.linalg.solve(MASS, given["force"].T).T
    np.testing.assert_allclose(found(given, ()), expected, atol=1e-3)
