"""Writes what a chunk of episodes leaves besides its rows: recordings as Parquet, and what applications printed.

Recordings have a row a sample (docs/reference/recordings-schema.md). A chunk has one file: 100,000 episodes would be as
many objects, each with a footer larger than what most episodes leave. Rows stand in the order of episodes and time, and
every row group says which episodes it holds, so that a reader fetches one episode without the others.
"""

import functools
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa

from specs.field_types import OutputLocation
from tasks.results.tables.episode_tables import described_field
from tasks.results.tables.parquet import ParquetFile
from tasks.storage.base.keys import checked_name, output_key
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store

RECORDINGS_FOLDER = "recordings"
SCHEMA_VERSION = "1"
_REPEATED = ("index", "t_s", "goal_index")
_REALS = pa.list_(pa.float32())
RECORDING = pa.schema(
    [
        described_field("index", pa.int32(), "", "Position of the job in the batch, from 0."),
        described_field("t_s", pa.float64(), "s", "Simulated time since the episode began."),
        described_field("x_m", pa.float32(), "m", "Position of the robot's base, x."),
        described_field("y_m", pa.float32(), "m", "Position of the robot's base, y."),
        described_field("yaw_rad", pa.float32(), "rad", "Its heading, counter-clockwise from +x."),
        described_field("vx_m_s", pa.float32(), "m/s", "Its velocity along the world's x."),
        described_field("vy_m_s", pa.float32(), "m/s", "Its velocity along the world's y."),
        described_field("yaw_rad_s", pa.float32(), "rad/s", "How fast it turns."),
        described_field("goal_index", pa.int32(), "", "The goal that it should go to; how many were reached."),
        described_field(
            "control", _REALS, "", "What the controller decided, a number an actuator; empty in an episode's last row."
        ),
        described_field("ranges_m", _REALS, "m", "The scan that it decided on, a number a ray; empty like control."),
        described_field("impulse_ns", pa.float32(), "Ns", "What contacts pushed the robot with until the next row."),
    ],
    metadata={"simyard.table": "recording", "simyard.schema_version": SCHEMA_VERSION},
)

DEPTH_PNG, COLOR_JPEG = "depth_png", "color_jpeg"
PICTURES = pa.schema(
    [
        described_field(name, pa.binary(), "", meaning, nullable=True)
        for name, meaning in (
            (DEPTH_PNG, "What its depth camera saw, as PNG in millimetres (16 bits); null at most rows."),
            (COLOR_JPEG, "What its colour camera saw, as JPEG; null at most rows."),
        )
    ]
)
"""The columns of a batch that keeps pictures, behind the others."""


def recordings_url(store_url: str, location: OutputLocation, batch_id: str) -> str:
    """Returns where a batch's recordings lie."""
    bucket = open_bucket(open_store(store_url), location.s3Bucket or "")
    return f"{bucket.url}/{_key(location, batch_id)}"


def write_recordings(
    store_url: str,
    location: OutputLocation,
    batch_id: str,
    number: int,
    parts: Iterable[Mapping[str, np.ndarray]],
    *,
    pictures: bool = False,
) -> str:
    """Writes the recordings of one chunk, and returns the name of their file; empty if there are none.

    The same recordings again give the same bytes, whatever an attempt that was broken off left there.

    Args:
        store_url: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        number: The chunk's number.
        parts: Samples as columns, in the order of episodes and time: ``index``, ``t_s``, ``pose``, ``velocity``,
            ``goal_index``, ``acted`` (whether there is a control), ``control``, ``ranges_m``, ``impulse_ns``.
        pictures: Whether they have ``PICTURES`` as well.
    """
    bucket = open_bucket(open_store(store_url), location.s3Bucket or "")
    name = f"{number:06d}.parquet"
    key = f"{_key(location, batch_id)}/{name}"
    with tempfile.TemporaryDirectory(prefix="simyard-recordings-") as folder:
        rows = 0
        schema = recording_schema(pictures=pictures)
        with ParquetFile(Path(folder) / name, schema, dictionary=_REPEATED) as file:
            for part in parts:
                file.add(recording_table(part))
                rows += len(part["index"])
        if rows:
            bucket.upload(key, Path(folder) / name)
            return name
    bucket.delete(key)
    return ""


def recording_schema(*, pictures: bool) -> pa.Schema:
    """Returns the columns of a recording."""
    return functools.reduce(pa.Schema.append, PICTURES if pictures else (), RECORDING)


def recording_table(samples: Mapping[str, np.ndarray]) -> pa.Table:
    """Returns samples as rows with the columns of ``RECORDING``, and with those of ``PICTURES`` if they have them."""
    pose, velocity, acted = samples["pose"], samples["velocity"], samples["acted"]
    columns: dict[str, pa.Array] = {
        "index": pa.array(samples["index"], pa.int32()),
        "t_s": pa.array(samples["t_s"], pa.float64()),
        **{name: _real(pose[:, axis]) for axis, name in enumerate(("x_m", "y_m", "yaw_rad"))},
        **{name: _real(velocity[:, axis]) for axis, name in enumerate(("vx_m_s", "vy_m_s", "yaw_rad_s"))},
        "goal_index": pa.array(samples["goal_index"], pa.int32()),
        "control": _lists(samples["control"], acted),
        "ranges_m": _lists(samples["ranges_m"], acted),
        "impulse_ns": _real(samples["impulse_ns"]),
    }
    kept = {field.name: pa.array(samples[field.name], field.type) for field in PICTURES if field.name in samples}
    schema = recording_schema(pictures=bool(kept))
    return pa.table([(columns | kept)[field.name] for field in schema], schema=schema)


def _key(location: OutputLocation, batch_id: str) -> str:
    return output_key(location.s3Prefix, f"{RECORDINGS_FOLDER}/{checked_name(batch_id, 'batch')}")


def _real(values: np.ndarray) -> pa.Array:
    return pa.array(np.ascontiguousarray(values, np.float32))


def _lists(values: np.ndarray, there: np.ndarray) -> pa.Array:
    """Returns each row's values as a list; an empty one where they are not there."""
    ends = np.cumsum(there * values.shape[1])
    offsets = np.concatenate([[0], ends]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), _real(values[there].reshape(-1)), type=_REALS)


OUTPUT_FOLDER = "output"


def write_output(store_url: str, location: OutputLocation, batch_id: str, number: int, text: str) -> None:
    """Writes what applications printed while a chunk was simulated, over what an earlier attempt at it printed.

    Args:
        store_url: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        number: The chunk's number.
        text: What was printed.
    """
    bucket = open_bucket(open_store(store_url), location.s3Bucket or "")
    key = output_key(location.s3Prefix, f"{OUTPUT_FOLDER}/{checked_name(batch_id, 'batch')}/{number:06d}.txt")
    bucket.put(key, text.encode())
