"""How hard a robot's contact with a person is, against the limits of ISO/TS 15066:2016, annex A.

The model is the annex's (A.3): robot and body region are two masses, and the region is a spring between them. A contact
at a speed v against each other is inelastic: all of the kinetic energy ``E = mu v^2 / 2`` goes into the spring, and its
force comes to ``F = v sqrt(mu k)``, so that ``E = F^2 / (2 k)``. Here ``mu = 1 / (1 / h + 1 / r)``, with the masses h
of the region and r of the robot, and the spring constant k of the region (table A.3). A contact of a person who can
give way is transient. One of a person before a solid is not: it cannot recoil, so ``mu = r``, and the limit is the
quasi-static one.

What is assumed, beyond the annex's own words:

- The robot's whole mass counts: all of a mobile base moves, while the annex takes half of an arm's moving mass.
- All of the hull is as hard as what the annex measured with, and as broad that force is what counts: pressure (N/cm2)
  depends on edges that nobody measures here, and a bumper's padding, which makes contacts softer, counts for nothing.
- The person is an adult of 1.7 m who stands. Whoever sits, kneels, lies or is a child has other regions at a height.
- The speed is that of the base and of the person, whole, in whatever direction they touch: a graze counts as a blow.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from specs.data.people import PERSON_HEIGHT_M
from tasks.simulate.application.robot_model import Hull

Reals = Float64[np.ndarray, " episodes"]
_LEAST_KG = 1e-9


class BodyRegion(NamedTuple):
    """A region of the body model of ISO/TS 15066.

    Attributes:
        low, high: Between which shares of the stature it is, standing (Drillis and Contini, Body segment parameters,
            1966: knee 0.285, fingertips 0.377, wrist 0.485, hip 0.530, elbow 0.630, shoulder 0.818, chin 0.870, eyes
            0.936); where belly and chest begin is ours.
        mass_kg: Its effective mass (table A.3).
        stiffness_n_m: Its effective spring constant (table A.3, there in N/mm).
        quasi_static_n: The force that is permissible while it is pinned (table A.2).
        transient_n: While it can recoil: twice that (table A.2), where the table has a factor at all.
    """

    name: str
    low: float
    high: float
    mass_kg: float
    stiffness_n_m: float
    quasi_static_n: float
    transient_n: float


def _region(name: str, low: float, high: float, given: tuple[float, float, float], factor: float = 2.0) -> BodyRegion:
    mass_kg, n_mm, quasi_static_n = given
    return BodyRegion(name, low, high, mass_kg, 1e3 * n_mm, quasi_static_n, factor * quasi_static_n)


BODY_REGIONS = (
    _region("lower legs", 0.0, 0.285, (75.0, 60.0, 130.0)),
    _region("thighs and knees", 0.285, 0.530, (75.0, 50.0, 220.0)),
    _region("hands and fingers", 0.377, 0.485, (0.6, 75.0, 140.0)),
    _region("lower arms and wrist joints", 0.485, 0.630, (2.0, 40.0, 160.0)),
    _region("pelvis", 0.485, 0.600, (40.0, 25.0, 180.0)),
    _region("abdomen", 0.600, 0.680, (40.0, 10.0, 110.0)),
    _region("upper arms and elbow joints", 0.630, 0.818, (3.0, 30.0, 150.0)),
    _region("chest", 0.680, 0.818, (40.0, 25.0, 140.0)),
    _region("back and shoulders", 0.600, 0.818, (40.0, 35.0, 210.0)),
    _region("neck", 0.818, 0.870, (1.2, 50.0, 150.0)),
    # The head has no transient limit, as nothing may hit it: what it stands while pinned is taken for one.
    _region("face", 0.870, 0.936, (4.4, 75.0, 65.0), factor=1.0),
    _region("skull and forehead", 0.936, 1.0, (4.4, 150.0, 130.0), factor=1.0),
)
"""From below, each as tables A.2 and A.3 have it; of its places the one that stands least."""


class Impacts(NamedTuple):
    """How hard the hardest contacts of episodes were; with a margin of 1 without any.

    Attributes:
        energy_j: What a contact put into the region that took most of it.
        force_n: The force on the region that it was highest on, pressing included.
        force_margin: 1 less the highest share of its limit that the force on a region came to; below 0 is above it.
    """

    energy_j: Reals
    force_n: Reals
    force_margin: Reals


def regions_met(hull: Hull) -> list[BodyRegion]:
    """Returns the regions at the heights of a hull; the highest for one that begins above a person."""
    low, high = hull.low_m / PERSON_HEIGHT_M, hull.high_m / PERSON_HEIGHT_M
    return [each for each in BODY_REGIONS if low < each.high and high > each.low] or [BODY_REGIONS[-1]]


def recoiling_kg(region: BodyRegion, robot_kg: Reals) -> Reals:
    """Returns the mass that a contact with a region moves that can recoil; with a pinned one it is the robot's."""
    return 1.0 / (1.0 / region.mass_kg + 1.0 / np.maximum(robot_kg, _LEAST_KG))


def impact(region: BodyRegion, moved_kg: Reals, speed_m_s: Reals) -> tuple[Reals, Reals]:
    """Returns energy (J) and force (N) of a contact that moves a mass at a speed against each other."""
    return 0.5 * moved_kg * speed_m_s**2, speed_m_s * np.sqrt(moved_kg * region.stiffness_n_m)


def impacts(hull: Hull, mass_factors: Reals, impact_m_s: Reals, pinned_m_s: Reals, pressed_ns: Reals) -> Impacts:
    """Returns how hard the hardest contacts of episodes were, on any region that the hull meets.

    Args:
        hull: The robot's.
        mass_factors: What its mass was multiplied with.
        impact_m_s: The highest speed of a contact.
        pinned_m_s: Of one with a person who was pinned; among the others as well.
        pressed_ns: The most that it pushed a person within a control step, long after a contact began.
    """
    robot_kg, pressed_n = hull.mass_kg * mass_factors, pressed_ns / CONTROL_S
    energies, forces, shares = [np.zeros_like(impact_m_s)], [pressed_n], [np.zeros_like(impact_m_s)]
    for region in regions_met(hull):
        recoiled_j, recoiled_n = impact(region, recoiling_kg(region, robot_kg), impact_m_s)
        pinned_j, pinned_n = impact(region, robot_kg, pinned_m_s)
        held_n = np.maximum(pinned_n, pressed_n)
        energies += [recoiled_j, pinned_j]
        forces += [recoiled_n, held_n]
        shares += [recoiled_n / region.transient_n, held_n / region.quasi_static_n]
    return Impacts(np.max(energies, axis=0), np.max(forces, axis=0), 1.0 - np.max(shares, axis=0))
