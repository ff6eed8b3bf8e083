"""What a stretch of a batch's episodes is asked for, as columns: computed from the layout without an object a row."""

import numpy as np

from specs.data.episode_columns import Cells, RequestColumns, distinct
from tasks.simulate.plan.episode_layout import Layout


def request_columns(layout: Layout, first: int, end: int) -> RequestColumns:
    """Returns the episodes from ``first`` to before ``end``.

    Args:
        layout: The batch's.
        first: Position of the first one.
        end: Position after the last one.
    """
    plan, offsets, index = layout.plan, np.array(layout.offsets), np.arange(first, end)
    template = np.searchsorted(offsets, index, side="right") - 1
    rest, seed = np.divmod(index - offsets[template], len(plan.seeds))
    world, setting = np.divmod(rest, layout.settings)
    worlds = [plan.worlds_of(asked) for asked in plan.templates]
    place = {name: number for number, name in enumerate(dict.fromkeys(name for names in worlds for name in names))}
    codes = np.array([place[name] for names in worlds for name in names], np.int64)
    starts = np.cumsum([0, *map(len, worlds)])
    launches, launch = distinct([template, setting])
    return RequestColumns(
        index=index,
        seeds=np.array(plan.seeds, np.int64)[seed],
        worlds=Cells(codes=codes[starts[template] + world], labels=tuple(place)),
        launches=tuple(layout.request(first + row) for row in launches),
        launch=launch,
    )
