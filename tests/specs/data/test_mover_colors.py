"""A colour of what moves is the same in a style sheet, in a film, and where it is between 0 and 1."""

from specs.data.mover_colors import BOX, PERSON


def test_a_colour_is_written_in_each_way():
    assert (BOX.code, BOX.shares) == ("#8d6e3f", (0.55, 0.43, 0.25))
    assert (PERSON.code, PERSON.shares) == ("#a142f4", (0.63, 0.26, 0.96))
