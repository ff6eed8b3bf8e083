"""What a report shows of causes: shades by decades, probabilities as people say them, columns that fit."""

import pytest

from tasks.results.report.cause_view import _shade, causes_view, how_often
from tasks.results.statistics.failure_causes import FailureCauses
from tests.results.report.test_report_page import EVIL, some_causes


@pytest.mark.parametrize(
    ("probability", "said"), [(0.0, "none"), (1.0, "100 %"), (0.1, "10 %"), (1 / 11, "1 in 11"), (1e-4, "1 in 10,000")]
)
def test_a_probability_is_said_as_people_say_it(probability: float, said: str):
    assert how_often(probability) == said


@pytest.mark.parametrize(("probability", "shade"), [(0.3, 1.0), (0.03, 0.667), (0.0003, 0.0), (1e-9, 0.0), (0.0, 0.0)])
def test_a_tenth_of_a_probability_has_a_third_less_shade(probability: float, shade: float):
    assert _shade(probability, 0.3) == shade


def test_the_most_probable_part_is_as_high_as_the_drawing():
    first = causes_view(some_causes()).rows[0]
    assert [(each.y, each.height) for each in first.bars][-2:] == [("89.5%", "10.5%"), ("0.0%", "100.0%")]
    assert first.bars[-1].text == "above 0.74: 1 in 105 (1 in 210 to 1 in 52)"
    assert first.bars[0].height == "0.0%"


def test_the_map_has_its_lowest_values_at_the_lower_left():
    found = causes_view(some_causes()).map
    assert found is not None
    corner = next(each for each in found.cells if (each.x, each.y) == (0, 90))
    assert corner.text == f"{EVIL} below 0.2, SIGMA below 0.2: 1 in 1,000,000,000"
    assert next(each for each in found.cells if each.shade == 1.0).x == 90
    assert found.dots == ((90.0, 5.0),)
    assert (found.strongest, found.lightest) == ("100 %", "1 in 1,000")


def test_worlds_of_one_generation_are_named_without_it():
    first = some_causes().causes[0]
    parts = tuple(each.model_copy(update={"values": f"wgj-1/{each.values}"}) for each in first.parts)
    worlds = first.model_copy(update={"name": "world", "parts": parts})
    assert causes_view(FailureCauses(causes=(worlds,))).rows[0].most == "above 0.74: 1 in 105"


def test_without_causes_it_says_why():
    found = causes_view(FailureCauses(why="seeds decide"))
    assert (found.rows, found.map, found.why) == ((), None, "seeds decide")
