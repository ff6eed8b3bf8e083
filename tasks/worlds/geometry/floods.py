"""What hangs together on a grid of free cells, which is one number with a bit for each cell.

Python's arithmetic takes all cells at once, so that no library has to be loaded that labels them.
"""

_LARGE_BITS = 10_000
_STEPS, _LARGE_STEPS = 16, 64


def flood(start: int, free: int, row: int) -> int:
    """Returns the free cells that a walk from some of them reaches; it goes to the four neighbours of a cell.

    Args:
        start: Where the walk begins; free cells.
        free: The free cells. The last of each row is never free: it keeps walks from going around.
        row: How many cells a row has.
    """
    strides = _strides(free, row)
    part, before = start, 0
    while part != before:
        before = part
        part |= free & ((free + part) ^ free)  # the carry runs from a cell to the end of the free ones after it
        for down, along, forward, back, over in strides:
            part |= part >> down & along
            part |= part << over & forward
            part |= part >> over & back
    return part


def _strides(free: int, row: int) -> list[tuple[int, int, int, int, int]]:
    """Returns strides of 1, 2, 4 cells and so on: where each may end, for all cells on its way are free.

    Each is: how many cells within a row, where it may end there, where it may end some rows on and some rows back, and
    how many cells these rows are.
    """
    strides: list[tuple[int, int, int, int, int]] = []
    along = forward = back = free
    step = 1
    while step < (_LARGE_STEPS if free.bit_length() > _LARGE_BITS else _STEPS):
        over = step * row
        strides.append((step, along, forward, back, over))
        along, forward, back = along & along >> step, forward & forward << over, back & back >> over
        step *= 2
    return strides
