"""Point 10, small things: prefixes that lead out of a bucket, and Markdown in Prefect's pages.

Files that others can read are attacked in test_07_up.py.
"""

import json
import os
import re
import shutil
import urllib.request

import pytest

from tasks.server.health import authorization
from tests.attacks.conftest import Owner
from tests.repository import ROOT

ACTIVE = "<img src=x onerror=alert(1)>|[click](javascript:alert(1))"
GENERATION = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}}


@pytest.fixture(autouse=True)
def _template(owner: Owner) -> None:  # pyright: ignore[reportUnusedFunction] - used by every test
    (owner.folder / "templates").mkdir()
    shutil.copy(ROOT / "examples/templates/two-rooms.json", owner.folder / "templates")


@pytest.mark.parametrize("prefix", ["../..", "a/../../b", "a\\..\\b", "a\x07b", "a\u202eb"])
def test_a_prefix_does_not_lead_out_of_its_bucket(owner: Owner, prefix: str):
    """A document brings a prefix that climbs out of its bucket: it is a fault of the document."""
    place = {"s3Bucket": "results", "s3Prefix": prefix}
    text = {"name": "small", "worldGeneration": GENERATION, "worldExport": {"outputLocation": place}}
    (owner.folder / "small.yaml").write_text(json.dumps(text))
    told = owner.simyard("validate", "small.yaml")
    assert (told.returncode, "a folder inside the bucket" in told.stdout) == (2, True)


def test_variables_are_no_markdown_on_prefects_pages(owner: Owner):
    """A variable's value is a link and an element of HTML: the tables on Prefect's pages have both as text."""
    launches = {
        "robotApplications": [
            {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "go_to_goal"}}
        ],
        "simulationApplications": [
            {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
        ],
    }
    batch = {
        "outputLocation": {"s3Bucket": "results"},
        "batchPolicy": {"maxConcurrency": 2},
        "audit": {"lanes": 0},
        "matrix": {"worlds": "all", "seeds": [1], "environmentVariables": {"NOTE": [ACTIVE, "plain"]}},
        "createSimulationJobRequests": [{"maxJobDurationInSeconds": 1, **launches}],
    }
    text = {"name": "small", "worldGeneration": GENERATION, "simulationBatch": batch}
    (owner.folder / "small.yaml").write_text(json.dumps(text))
    told = owner.simyard("run", "small.yaml")
    assert told.returncode == 0, told.stdout
    name = next(word for word in told.stdout.split() if ":simulation-job-batch:" in word).rpartition(":")[2]
    shown = "".join(each["data"] for each in _artifacts() if name in (each["description"] or ""))
    assert "NOTE" in shown
    # Of each `<` and `[` in front of it, what makes it text is left of it: a backslash, in JSON two.
    assert re.findall(r"(?<!\\)(<img|\[click\])", shown) == []


def _artifacts() -> list[dict[str, str]]:
    asked = urllib.request.Request(  # noqa: S310 - the test server's own URL
        f"{os.environ['PREFECT_API_URL']}/artifacts/filter",
        json.dumps({"sort": "CREATED_DESC", "limit": 30}).encode(),
        {"content-type": "application/json", **authorization(os.environ["PREFECT_API_AUTH_STRING"])},
    )
    with urllib.request.urlopen(asked, timeout=60) as answer:  # noqa: S310 - same
        return json.load(answer)
