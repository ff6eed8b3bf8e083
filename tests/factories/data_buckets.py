"""A bucket with two maps, and requests for them."""

from pathlib import Path

from specs.robomaker.simulation import DataSourceConfig

ONE = b"walls: []\n"


def source(*keys: str, **changes: object) -> DataSourceConfig:
    return DataSourceConfig.model_validate({"name": "maps", "s3Bucket": "maps-bucket", "s3Keys": keys, **changes})


def cache(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "data"
