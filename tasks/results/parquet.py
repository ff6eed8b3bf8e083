"""Parquet files whose bytes depend on the table and the metadata alone."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

ROW_GROUP_ROWS = 65_536


def write_parquet(table: pa.Table, path: Path, metadata: Mapping[str, str] | None = None) -> str:
    """Writes the table and returns the file's SHA-256.

    Row groups have a fixed size, compression is zstd, text is dictionary encoded, every column has statistics. The
    only other thing that the bytes depend on is the version of pyarrow, which Parquet's footer names.

    Args:
        table: Its schema's metadata goes into the footer too.
        path: A local file, overwritten.
        metadata: More for the footer, such as engine and versions; no times, no paths.
    """
    footer = {**_text(table.schema.metadata), **(metadata or {})}
    pq.write_table(
        table.replace_schema_metadata(dict(sorted(footer.items()))),
        path,
        row_group_size=ROW_GROUP_ROWS,
        version="2.6",
        data_page_version="1.0",  # every reader has it
        compression="zstd",
        compression_level=3,
        use_dictionary=True,
        write_statistics=True,
    )
    with path.open("rb") as written:
        return hashlib.file_digest(written, "sha256").hexdigest()


def _text(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}
