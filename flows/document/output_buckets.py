"""Output buckets that a run would make: on a server a bucket must be there, in a folder it is made when it is written.

A misspelt bucket would take the results and say nothing. To refuse it would break the first steps, and old documents
whose buckets nobody makes on a new machine; so `plan` and `run` name what is new, and what is there.
"""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from specs.pipeline.document import PipelineSpec
from tasks.simulate.plan.resolve import output_location
from tasks.storage.base.store import Store
from tasks.storage.buckets import bucket_url

_FOLDER = "file://"
_NAMED_AT_MOST = 10


def new_bucket_lines(spec: PipelineSpec, store: Store) -> Iterator[str]:
    """Yields a line for each output bucket of a document that is a folder which is not there yet."""
    places = [spec.worldExport.outputLocation] if spec.worldExport else []
    places += [output_location(spec.simulationBatch)] if spec.simulationBatch else []
    for name in dict.fromkeys(place.s3Bucket or "" for place in places):
        url = bucket_url(store, name)
        if url.startswith(_FOLDER) and not (folder := Path(unquote(url.removeprefix(_FOLDER)))).is_dir():
            yield f"bucket {name} is new, and is made in {folder}{_others(folder.parent)}"


def _others(home: Path) -> str:
    found = sorted(each.name for each in home.iterdir() if each.is_dir()) if home.is_dir() else []
    named = [each for each in found if not each.startswith(".")]
    more = ", ..." if len(named) > _NAMED_AT_MOST else ""
    return f"; there are {', '.join(named[:_NAMED_AT_MOST])}{more}" if named else ""
