"""Overlaps are found, touching things are not."""

import pytest

from specs.data.world import Furniture, Solid
from tasks.worlds.geometry import bounds, count_overlaps, solid_rows


def box(x: float, y: float = 0.0, yaw: float = 0.0, z: float = 0.5) -> Solid:
    return Solid(
        name=f"box {x} {y} {yaw} {z}",
        shape="box",
        center_m=(x, y, z),
        half_extents_m=(0.5, 0.5, 0.5),
        yaw_rad=yaw,
        color=(0.5, 0.5, 0.5),
    )


def piece(*parts: Solid) -> Furniture:
    return Furniture(name="p", model_type="Ottomans", room="r", center_m=(0.0, 0.0), yaw_rad=0.0, solids=parts)


@pytest.mark.parametrize(
    ("first", "second", "overlaps"),
    [
        (box(0.0), box(0.9), 1),
        (box(0.0), box(1.0), 0),
        (box(0.0), box(0.0, z=1.5), 0),
        (box(0.0), box(1.15, yaw=0.7853981), 1),
        (box(0.0), box(1.22, yaw=0.7853981), 0),
        (box(0.0, yaw=0.7853981), box(1.05, 1.05, yaw=0.7853981), 0),
        (box(0.0, yaw=0.7853981), box(0.65, 0.65, yaw=0.7853981), 1),
    ],
)
def test_two_pieces_overlap_when_they_share_space(first: Solid, second: Solid, overlaps: int) -> None:
    assert count_overlaps([piece(first), piece(second)], []) == overlaps
    assert count_overlaps([piece(first)], [second]) == overlaps


def test_primitives_of_one_piece_and_walls_among_themselves_do_not_count() -> None:
    assert count_overlaps([piece(box(0.0), box(0.2))], [box(5.0), box(5.1)]) == 0


def test_a_pair_counts_once_however_many_primitives_meet() -> None:
    assert count_overlaps([piece(box(0.0), box(0.1)), piece(box(0.2), box(0.3))], []) == 1


def test_a_turned_box_has_wider_bounds() -> None:
    x_min, _, z_min, x_max, _, z_max = bounds(solid_rows([box(0.0, yaw=0.7853981)]))[0]
    assert (x_max - x_min, z_max - z_min) == (pytest.approx(2**0.5), pytest.approx(1.0))
