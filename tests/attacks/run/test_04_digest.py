"""Point 4: what ran is what the digest says, and a robot's file neither leads out of its bundle nor explodes.

The check of MJCF is fuzzed in tests/simulate/application/test_mjcf_check.py, the seal is attacked file by file in
tests/storage/test_sealed_bundle.py, and bytecode in a bundle in tests/simulate/application/test_bundle_code.py.
"""

import json
import shutil
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner
from tests.repository import ROOT

# Whoever imports the other module runs this instead the next time, unless its bundle is as it was published.
BESIDE = """
from pathlib import Path

_OTHER = Path(__file__).with_name("go_to_goal.py")
try:
    _OTHER.parent.chmod(0o755)
    _OTHER.chmod(0o644)
    _OTHER.write_text("raise RuntimeError('another program ran under this digest')")
except OSError:
    pass
"""
EXPLODING = (
    '<mujoco><worldbody><body name="b"><replicate count="100000000"><site/></replicate></body></worldbody></mujoco>'
)
PLANAR = """<mujoco>{inner}<worldbody><body name="base" pos="0 0 0.2"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" type="hinge" axis="0 0 1"/>
<geom name="hull" type="sphere" size="0.15" mass="1.5"/></body></worldbody>
<actuator><velocity joint="x" kv="30"/><velocity joint="y" kv="30"/></actuator></mujoco>"""


def robot(owner: Owner, name: str = "mine") -> Path:
    """Returns the folder of a robot application of the owner's: the courier, to be changed."""
    shutil.copytree(ROOT / "applications/courier", owner.folder / name)
    return owner.folder / name


def document(owner: Owner, seed: int = 1, name: str = "mine") -> str:
    """Returns a document that simulates the application for a second of simulated time."""
    (owner.folder / "templates").mkdir(exist_ok=True)
    shutil.copy(ROOT / "examples/templates/two-rooms.json", owner.folder / "templates")
    launches = {
        "robotApplications": [
            {"application": name, "launchConfig": {"packageName": "courier", "launchFile": "go_to_goal"}}
        ],
        "simulationApplications": [
            {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
        ],
    }
    text = {
        "name": "digest",
        "applications": [{"name": name, "source": name}],
        "worldGeneration": {"template": "templates/two-rooms.json", "worldCount": {"floorplanCount": 1}},
        "simulationBatch": {
            "outputLocation": {"s3Bucket": "results"},
            "batchPolicy": {"maxConcurrency": 1},
            "audit": {"lanes": 0},
            "matrix": {"worlds": "all", "seeds": [seed]},
            "createSimulationJobRequests": [{"maxJobDurationInSeconds": 1, **launches}],
        },
    }
    (owner.folder / f"{seed}.yaml").write_text(json.dumps(text))
    return f"{seed}.yaml"


def test_an_application_that_writes_beside_itself_changes_nothing_for_the_next_run(owner: Owner):
    """An application, or another one, rewrites a bundle in the cache: each use compares it with its digest first."""
    source = robot(owner)
    init = source / "courier/__init__.py"
    init.write_text((init.read_text() if init.exists() else "") + BESIDE)
    first = owner.simyard("run", document(owner, 1))
    # Where the application is shut in, it could not; who has the account could.
    for path in Path(owner.environment["SIMYARD_CACHE"], "bundles").rglob("go_to_goal.py"):
        path.parent.chmod(0o755)
        path.chmod(0o644)
        path.write_text("raise RuntimeError('another program ran under this digest')")

    second = owner.simyard("run", document(owner, 2))

    assert (first.returncode, second.returncode) == (0, 0), second.stdout
    assert "RobotApplicationCrash" not in second.stdout
    assert "another program" not in owner.simyard("describe", _batch(second.stdout)).stdout


@pytest.mark.parametrize("command", ["validate", "plan", "run"])
def test_a_robot_of_a_hundred_million_parts_is_a_fault_of_the_document(owner: Owner, command: str):
    """A robot's file asks for a hundred million copies: it is counted, and refused, before MuJoCo makes any."""
    (robot(owner) / "robot.xml").write_text(EXPLODING)
    told = owner.simyard(command, document(owner))
    assert (told.returncode, "more than 5,000 elements" in told.stdout) == (2, True)


@pytest.mark.parametrize("inner", ['<include file="{}"/>', '<asset><include file="../{}"/></asset>'])
def test_a_robot_includes_no_file_of_this_machine(owner: Owner, inner: str):
    """A robot's file includes one outside its bundle, to bring it into a report: only its own bundle can be named."""
    secret = owner.folder / "secret.xml"
    secret.write_text('<mujocoinclude><statistic meansize="0.1"/></mujocoinclude>')
    given = secret.name if "../" in inner else str(secret)
    (robot(owner) / "robot.xml").write_text(PLANAR.format(inner=inner.format(given)))
    assert owner.simyard("app", "publish", "theirs", "mine").returncode == 0
    planned = owner.simyard("plan", document(owner))
    assert (planned.returncode, "must be a path inside the bundle" in planned.stdout) == (2, True)


def _batch(told: str) -> str:
    return next(word for word in told.split() if ":simulation-job-batch:" in word)
