"""The same document on a folder and on a real S3 server."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.runs import finished, jobs, tables, worlds

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]


@pytest.mark.long
def test_a_folder_and_s3_hold_the_same_worlds_and_result_tables(small_run: Path, s3_url: Callable[[], str]):
    url = s3_url()
    result = finished("run", str(small_run / "document.yaml"), "--store", url)
    assert result.returncode == 0, result.stderr
    there, here = open_store(url), open_store((small_run / ".simyard").as_uri())
    assert worlds(there) == worlds(here)
    assert tables(there)["results"].num_rows == 32
    assert all(tables(there)[name].equals(table) for name, table in tables(here).items())
    assert [[job.id for job in found] for found in jobs(there).values()] == [
        [job.id for job in found] for found in jobs(here).values()
    ]
