"""Energy and force of contacts with people: ISO/TS 15066's own figures, and two masses with a spring between them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from specs.data.episode import CONTROL_S
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.lane.person_impact import (
    BODY_REGIONS,
    BodyRegion,
    impact,
    impacts,
    recoiling_kg,
    regions_met,
)

REGIONS = {region.name: region for region in BODY_REGIONS}
ONE, NONE = np.ones(1), np.zeros(1)
COURIER = Hull(radius_m=0.18, low_m=0.02, high_m=0.38, mass_kg=2.0)

# ISO/TS 15066:2016, table A.4: limits of the transferred energy (J), of transient contacts. Those that it has of lower
# legs, hands and the neck are 7 % below what follows from its own forces of table A.2.
ENERGY_LIMITS_J = {
    "back and shoulders": 2.5,
    "chest": 1.6,
    "abdomen": 2.4,
    "pelvis": 2.6,
    "upper arms and elbow joints": 1.5,
    "lower arms and wrist joints": 1.3,
    "thighs and knees": 1.9,
}

# Its table A.5: permissible speeds (m/s) of robots with an effective mass of so many kilograms. Of the lower leg they
# follow from the pressure on 1 cm2 of calf, 420 N; of the thigh from the force of table A.2, 440 N.
SPEED_LIMITS = {
    ("lower legs", 420.0): {1.0: 1.7, 2.0: 1.2, 5.0: 0.8, 10.0: 0.58, 15.0: 0.48, 20.0: 0.43},
    ("thighs and knees", 440.0): {1.0: 2.0, 2.0: 1.4, 5.0: 0.92, 10.0: 0.67, 15.0: 0.56, 20.0: 0.5},
}


@pytest.mark.parametrize(("name", "limit_j"), ENERGY_LIMITS_J.items())
def test_the_energy_at_which_the_force_is_at_its_limit_is_the_published_one(name: str, limit_j: float):
    region = REGIONS[name]
    energy_j, force_n = impact(region, recoiling_kg(region, np.full(1, 5.0)), ONE)
    assert energy_j[0] * (region.transient_n / force_n[0]) ** 2 == pytest.approx(limit_j, abs=0.05)


@pytest.mark.parametrize(("which", "speeds"), SPEED_LIMITS.items())
def test_the_force_at_a_published_speed_is_the_one_that_it_follows_from(
    which: tuple[str, float], speeds: dict[float, float]
):
    name, limit_n = which
    region, robot_kg = REGIONS[name], np.array(list(speeds))
    _, force_n = impact(region, recoiling_kg(region, robot_kg), np.array(list(speeds.values())))
    np.testing.assert_allclose(force_n, limit_n, rtol=0.03)


@pytest.mark.parametrize("pinned", [False, True])
@pytest.mark.parametrize("name", ["lower legs", "chest", "hands and fingers"])
def test_the_force_is_that_of_two_masses_that_press_a_spring_together(name: str, *, pinned: bool):
    region, robot_kg, speed = REGIONS[name], 12.0, 0.7

    def rates(_: float, state: np.ndarray) -> list[float]:
        pressed_m, robot_m_s, region_m_s = state
        force = region.stiffness_n_m * pressed_m
        return [robot_m_s - region_m_s, -force / robot_kg, 0.0 if pinned else force / region.mass_kg]

    way = solve_ivp(rates, (0.0, 0.1), [0.0, speed, 0.0], max_step=1e-5, rtol=1e-9).y[0]
    moved_kg = np.full(1, robot_kg) if pinned else recoiling_kg(region, np.full(1, robot_kg))
    found = impact(region, moved_kg, np.full(1, speed))
    assert found[1][0] == pytest.approx(region.stiffness_n_m * way.max(), rel=1e-4)
    assert found[0][0] == pytest.approx(0.5 * region.stiffness_n_m * way.max() ** 2, rel=2e-4)


@pytest.mark.parametrize(
    ("high_m", "names"),
    [
        (0.38, ["lower legs"]),
        (0.6, ["lower legs", "thighs and knees"]),
        (0.95, ["lower legs", "thighs and knees", "hands and fingers", "lower arms and wrist joints", "pelvis"]),
        (1.9, [region.name for region in BODY_REGIONS]),
    ],
)
def test_the_regions_that_a_hull_meets_are_those_at_its_heights(high_m: float, names: list[str]):
    assert [region.name for region in regions_met(COURIER._replace(high_m=high_m))] == names


def test_a_hull_above_everybody_meets_heads():
    above = COURIER._replace(low_m=1.8, high_m=2.0)
    assert [region.name for region in regions_met(above)] == ["skull and forehead"]


def hardest(region: BodyRegion) -> tuple[float, float]:
    """Returns the force, and its share of the limit, of a courier of 2 kg at 0.5 m/s, worked out by hand."""
    mass = 2.0 * region.mass_kg / (2.0 + region.mass_kg)
    force = 0.5 * (mass * region.stiffness_n_m) ** 0.5
    return force, force / region.transient_n


def test_a_courier_at_half_a_metre_a_second_is_below_the_limit_of_a_leg():
    found = impacts(COURIER, ONE, np.full(1, 0.5), NONE, NONE)
    force, share = hardest(REGIONS["lower legs"])
    assert (found.force_n[0], found.force_margin[0]) == pytest.approx((force, 1.0 - share))
    assert 0.6 < share < 0.7
    assert found.energy_j[0] == pytest.approx(0.5 * (150.0 / 77.0) * 0.25)


def test_who_is_pinned_stands_half_as_much_and_recoils_with_nothing():
    free = impacts(COURIER, ONE, np.full(1, 0.4), NONE, NONE)
    pinned = impacts(COURIER, ONE, np.full(1, 0.4), np.full(1, 0.4), NONE)
    assert pinned.force_n[0] == pytest.approx(0.4 * (2.0 * 60e3) ** 0.5)
    assert pinned.force_margin[0] == pytest.approx(1.0 - pinned.force_n[0] / 130.0)
    assert 1.0 - pinned.force_margin[0] > 2.0 * (1.0 - free.force_margin[0])
    assert pinned.energy_j[0] == pytest.approx(0.5 * 2.0 * 0.16)


def test_a_robot_that_goes_on_pressing_is_held_to_the_quasi_static_limit():
    pressed = impacts(COURIER, ONE, NONE, NONE, np.full(1, 195.0 * CONTROL_S))
    assert (pressed.force_n[0], pressed.force_margin[0], pressed.energy_j[0]) == pytest.approx((195.0, -0.5, 0.0))


def test_a_heavier_robot_hits_harder_and_one_without_contacts_not_at_all():
    found = impacts(COURIER, np.array([1.0, 4.0, 4.0]), np.array([0.3, 0.3, 0.0]), np.zeros(3), np.zeros(3))
    assert found.force_n[1] > 1.8 * found.force_n[0] > 0.0
    assert (found.energy_j[2], found.force_n[2], found.force_margin[2]) == (0.0, 0.0, 1.0)
