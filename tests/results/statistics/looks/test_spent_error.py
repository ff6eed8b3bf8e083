"""The error that looks share: it adds up to alpha, and a normal walk that is tested so errs as often."""

from statistics import NormalDist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.statistics.interim_analyses import nominal_levels, spent_error

looks = st.lists(st.integers(1, 400), min_size=1, max_size=12, unique=True).map(sorted).map(tuple)


@given(looks, st.floats(0.001, 0.2))
def test_what_may_be_spent_rises_to_alpha(at: tuple[int, ...], alpha: float):
    spent = spent_error(at, alpha)
    assert list(spent) == sorted(spent)
    assert spent[0] > 0.0
    assert spent[-1] == pytest.approx(alpha)


def test_what_may_be_spent_depends_on_the_share_of_the_batch_alone():
    assert spent_error((16, 48, 64), 0.025) == pytest.approx(spent_error((160, 480, 640), 0.025))


@pytest.mark.parametrize("at", [(), (0, 3), (3, 3), (5, 4)])
def test_looks_that_do_not_rise_are_refused(at: tuple[int, ...]):
    with pytest.raises(ValueError, match="rising"):
        spent_error(at, 0.025)


def test_five_equal_looks_that_spend_as_o_brien_and_fleming_have_their_critical_values():
    # Jennison and Turnbull 2000, tables 2.3 and 7.1: alpha .05 two-sided; Lan and DeMets 1983, table 1, for spending.
    normal = NormalDist()
    values = [2.0401 * (5 / look) ** 0.5 for look in range(1, 6)]
    exact = _crossing([5, 10, 15, 20, 25], [1.0 - normal.cdf(value) for value in values])
    assert exact[-1] == pytest.approx(0.025, abs=1e-5)
    levels = nominal_levels([5, 10, 15, 20, 25], exact)
    assert [normal.inv_cdf(1.0 - level) for level in levels] == pytest.approx(values, abs=5e-3)
    spent = [2.0 * (1.0 - normal.cdf(normal.inv_cdf(1.0 - 0.0125) / (look / 5) ** 0.5)) for look in range(1, 6)]
    last = normal.inv_cdf(1.0 - nominal_levels([1, 2, 3, 4, 5], spent)[-1])
    assert last == pytest.approx(2.03, abs=0.01)


def test_one_look_has_all_of_the_error():
    assert nominal_levels([384], [0.025]) == pytest.approx([0.025], rel=1e-6)


def _crossing(looks: list[int], levels: list[float]) -> list[float]:
    """Returns the error spent at each look by critical values, found by what gives them back."""
    spent = list[float]()
    for level in levels:
        low, high = (spent[-1] if spent else 0.0), (spent[-1] if spent else 0.0) + level
        for _ in range(40):
            middle = (low + high) / 2.0
            at = looks[: len(spent) + 1]
            found = nominal_levels(at, [*spent, middle])[-1]
            low, high = (middle, high) if found < level else (low, middle)
        spent.append(high)
    return spent
