"""The terminal: what a stranger wrote into the store is text there, and nothing else.

That `simyard fleet watch` reads no reason as markup: tests/flows/cli/test_fleet_watch.py.
"""

import json

import pytest

from specs.untrusted_text import terminal_text
from tests.attacks.conftest import Owner, Writer
from tests.repository import ROOT

# Erases the screen, colours what follows, sets the window's title, turns text around; and a closing tag of rich's.
HOSTILE = "\x1b[2J\x9b31m\x1b]0;owned\x07\u202eno camera at [/dev/video0]\r"
KINDS = ("world-generation-job", "pipeline-run")


@pytest.fixture
def records(owner: Owner, writer: Writer) -> list[str]:
    """ARNs of jobs whose records the attacker has rewritten."""
    (owner.folder / "templates").mkdir()
    template = (ROOT / "examples/templates/two-rooms.json").read_text()
    (owner.folder / "templates/two-rooms.json").write_text(template)
    generation = {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}}
    (owner.folder / "worlds.yaml").write_text(json.dumps({"name": "worlds", "worldGeneration": generation}))
    assert owner.simyard("run", "worlds.yaml", "--direct").returncode == 0
    found: list[str] = []
    for key in (key for kind in KINDS for key in writer.keys(f"jobs/{kind}/")):
        record = json.loads(writer.get(key))
        record |= {"status": "Failed", "failure_code": "InternalServiceError", "failure_reason": HOSTILE}
        record["detail"] = {**record["detail"], "failures": {HOSTILE: {"count": 1, "sample_reason": HOSTILE}}}
        writer.put(key, json.dumps(record, ensure_ascii=False).encode())
        found.append(record["arn"])
    return found


def test_what_a_stranger_wrote_does_not_steer_the_terminal(owner: Owner, records: list[str]):
    """The attacker writes control and bidi characters into records: whatever is printed, is printed without them."""
    commands = [("list", f"{kind}s") for kind in KINDS] + [("describe", arn) for arn in records]
    told = [owner.simyard(*command).stdout for command in commands]
    assert [text for text in told if terminal_text(text) != text] == []
    assert "/dev/video0" in "".join(told)
