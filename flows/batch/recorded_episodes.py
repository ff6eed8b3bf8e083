"""What recorded episodes of a batch leave: samples in Parquet, and bags for ROS's tools if they are asked for.

Parquet is the record; a bag is made of the same samples.
"""

import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from specs.field_types import OutputLocation
from tasks.results.playback.replay_formats import is_installed, require_bag_writers
from tasks.results.tables.recordings import write_recordings
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.prepared_chunks import load_worlds
from tasks.simulate.lane.recording import Columns
from tasks.storage.base.key_rules import checked_name
from tasks.storage.base.keys import output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket

BAGS_FOLDER = "bags"


class RecordedEpisodes:
    """Writes what recorded episodes leave, before the chunk that names them is committed."""

    def __init__(self, batch: OpenBatch, location: OutputLocation, folders: Mapping[str, Path]) -> None:
        """Begins with a batch, its output location, and the unpacked folders of its applications by digest."""
        self._batch, self._location, self._folders = batch, location, folders
        self._written: dict[int, set[str]] = {}

    def write(self, chunk: int, parts: Iterable[Columns]) -> str:
        """Returns the name of the file of a chunk's recordings; empty if there are none.

        Called again for a chunk, it writes over what it wrote, and removes the bags of who was cancelled meanwhile.

        Raises:
            DocumentError: Bags are asked for, and nothing here can write them.
        """
        before, now = self._written.get(chunk, set[str]()), set[str]()
        kept = self._with_bags(parts, now) if bags_written(self._batch) else parts
        name = write_recordings(self._batch.store.url, self._location, self._batch.id, chunk, kept)
        for key in sorted(before - now):
            self._bucket().delete(key)
        self._written[chunk] = now
        return name

    def _with_bags(self, parts: Iterable[Columns], written: set[str]) -> Iterator[Columns]:
        """Yields the parts as they are, having written the bags of their episodes; notes the keys."""
        for part in parts:
            written.update(self._write_bags(part))
            yield part

    def _write_bags(self, samples: Columns) -> Iterator[str]:
        from tasks.results.playback.ros_log import RosView, sample_logs  # noqa: PLC0415 - an extra
        from tasks.ros.bag.bag_file import write_bags  # noqa: PLC0415
        from tasks.simulate.replay.robot_view import robot_view  # noqa: PLC0415 - it loads MuJoCo

        bucket, plan, layout = self._bucket(), self._batch.plan, self._batch.layout
        requests = {index: layout.request(index) for index in dict.fromkeys(samples["index"].tolist())}
        worlds, _ = load_worlds(self._batch, requests.values())
        views = {
            index: RosView(worlds[request.world], *robot_view(self._folders[request.robot.digest]))
            for index, request in requests.items()
        }
        for index, log in sample_logs(views, samples):
            formats = plan.bags_of(plan.templates[layout.template_of(index)])
            with tempfile.TemporaryDirectory(prefix="simyard-bags-") as folder:
                for path in write_bags(Path(folder), f"{index:06d}", log, formats):
                    key = f"{self._folder()}/{path.relative_to(folder).as_posix()}"
                    bucket.upload(key, path)
                    yield key

    def _bucket(self) -> Store:
        return open_bucket(self._batch.store, self._location.s3Bucket or "")

    def _folder(self) -> str:
        return _bags_folder(self._batch, self._location)


def bags_written(batch: OpenBatch) -> bool:
    """Returns whether a batch's recorded episodes leave bags on this machine.

    A request of before that asks to record all topics does not fail for want of an extra; a document that asks for bags
    does.

    Raises:
        DocumentError: They are asked for, and nothing here can write them.
    """
    if not batch.plan.makes_bags():
        return False
    require_bag_writers(batch.plan.recordings.bags)
    return is_installed("ros")


def bags_url(batch: OpenBatch, location: OutputLocation) -> str:
    """Returns where a batch's bags lie."""
    return f"{open_bucket(batch.store, location.s3Bucket or '').url}/{_bags_folder(batch, location)}"


def _bags_folder(batch: OpenBatch, location: OutputLocation) -> str:
    return output_key(location.s3Prefix, f"{BAGS_FOLDER}/{checked_name(batch.id, 'batch')}")
