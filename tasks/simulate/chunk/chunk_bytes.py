"""A chunk's results as bytes, and who vouches for them.

A chunk begins with what vouches for all that follows: columns, or in one of an older version rows of JSON
(docs/decisions/0040-results-as-columns.md). NumPy is imported when a chunk is read or written: who lists jobs does
neither.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pydantic import TypeAdapter

from specs.data.episode import EpisodeResult
from tasks.storage.jobs.voucher import MAC_LENGTH, Voucher

if TYPE_CHECKING:
    from specs.data.episode_columns import EpisodeColumns

_ROWS = TypeAdapter(list[EpisodeResult])
_BEGIN, _COLUMNS = b'{"mac":"', b'"}\n'
_ROWS_MIDDLE, _ROWS_END = b'","rows":', b"}"


def vouched_bytes(results: "Sequence[EpisodeResult] | EpisodeColumns", number: int, voucher: Voucher) -> bytes:
    """Returns a chunk's bytes; of equal results the same.

    Args:
        results: Of its episodes.
        number: The chunk's.
        voucher: Vouches for them.
    """
    from specs.data.column_bytes import encode_columns
    from specs.data.episode_columns import EpisodeColumns

    body = encode_columns(EpisodeColumns.of(results))
    return b"".join([_BEGIN, voucher.mac(_columns_name(number), body).encode(), _COLUMNS, body])


def results_in(body: bytes) -> "EpisodeColumns":
    """Returns the results in a chunk, whoever wrote them.

    Raises:
        ValueError: There are none.
    """
    from specs.data.column_bytes import decode_columns
    from specs.data.episode_columns import EpisodeColumns

    mac, columns = _split(body, _COLUMNS)
    if mac is not None:
        return decode_columns(columns)
    try:
        return EpisodeColumns.of(_ROWS.validate_json(_json_rows(body)[1]))
    except OverflowError as exc:
        raise ValueError("a number beyond 64 bits") from exc


def is_vouched(body: bytes, number: int, voucher: Voucher) -> bool:
    """Returns whether an owner vouches for a chunk's bytes, under its number."""
    mac, columns = _split(body, _COLUMNS)
    if mac is not None:
        return voucher.vouches(mac, _columns_name(number), columns)
    mac, rows = _json_rows(body)
    return voucher.vouches(mac, f"chunk {number}", rows)


def _json_rows(body: bytes) -> tuple[str, bytes]:
    """Returns what vouches for the rows of an older version, and their bytes; for the oldest nothing does."""
    mac, rows = _split(body, _ROWS_MIDDLE)
    if mac is None or not rows.endswith(_ROWS_END):
        return "", body
    return mac, rows[: -len(_ROWS_END)]


def _split(body: bytes, middle: bytes) -> tuple[str | None, bytes]:
    """Returns what vouches for what stands behind some bytes, and that; None if it does not stand there."""
    place = len(_BEGIN) + MAC_LENGTH
    if not body.startswith(_BEGIN) or body[place : place + len(middle)] != middle:
        return None, body
    return body[len(_BEGIN) : place].decode(errors="replace"), body[place + len(middle) :]


def _columns_name(number: int) -> str:
    return f"columns of chunk {number}"
