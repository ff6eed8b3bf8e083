"""What only one of two batches asked of its episodes, so that they have fewer of them in common."""

from collections.abc import Collection, Iterable, Iterator, Mapping

import pyarrow as pa

_NAMED = 5
_NOT_SET = "(not set)"


def apart(first: pa.Table, second: pa.Table, worlds: Mapping[str, str], others: Mapping[str, str]) -> Iterator[str]:
    """Yields what only one of two batches has: values of environment variables, worlds, seeds; a line each.

    Args:
        first: The rows of one batch's ``results.parquet``.
        second: The rows of the other's.
        worlds: What tells the first batch's worlds apart, by ``<generation>/<world>``.
        others: The same of the second batch.
    """
    one, other, unset = _variables(first), _variables(second), {_NOT_SET: None}
    for name in sorted(one.keys() | other.keys()):
        yield from _told(name, one.get(name, unset), other.get(name, unset))
    yield from _told("worlds", _worlds(first, worlds), _worlds(second, others), counted=True)
    yield from _told("seeds", _seeds(first), _seeds(second))


def _variables(table: pa.Table) -> dict[str, dict[str, None]]:
    """Returns the values of each environment variable, in order; an episode may not set one that others do."""
    settings = dict.fromkeys(tuple(row) for row in table.column("environment").to_pylist())
    named = [dict(setting) for setting in settings]
    names = dict.fromkeys(name for setting in named for name in setting)
    return {name: {setting.get(name, _NOT_SET): None for setting in named} for name in names}


def _worlds(table: pa.Table, identities: Mapping[str, str]) -> dict[str, None]:
    return dict.fromkeys(identities.get(name, name) for name in table.column("world").unique().to_pylist())


def _seeds(table: pa.Table) -> dict[str, None]:
    return dict.fromkeys(map(str, sorted(table.column("seed").unique().to_pylist())))


def _told(name: str, one: Collection[str], other: Collection[str], *, counted: bool = False) -> Iterator[str]:
    sides = ((one, other, "the first"), (other, one, "the second"))
    alone = [(_own(mine, theirs), which) for mine, theirs, which in sides]
    said = [f"{len(own) if counted else _some(own)} only in {which}" for own, which in alone if own]
    if said:
        yield f"{name}: {'; '.join(said)}"


def _own(mine: Iterable[str], theirs: Collection[str]) -> list[str]:
    return [value for value in mine if value not in theirs]


def _some(values: list[str]) -> str:
    more = f" and {len(values) - _NAMED} more" if len(values) > _NAMED else ""
    return ", ".join(values[:_NAMED]) + more
