"""What a gateway has imported when it has answered the calls about jobs: nothing that only a worker needs."""

import json
import subprocess
import sys

from tests.flows.gateway.jobs.asked import Asked
from tests.repository import ROOT

HEAVY = {"prefect", "jax", "jaxlib", "mujoco", "pyarrow", "numpy", "scipy", "trimesh", "matplotlib", "PIL"}
CODE = """
import json, sys
from flows.gateway.application import Application
from flows.gateway.application import Calls
from tasks.storage.store_url import open_store
from tests.flows.gateway.jobs.asked import Asked, asked_for_everything

asked_for_everything(Asked(open_store(sys.argv[1])))
print(json.dumps(sorted(sys.modules)))
"""


def test_the_calls_about_jobs_need_nothing_that_simulates(asked: Asked):
    ended = subprocess.run(
        [sys.executable, "-c", CODE, asked.store.url], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert sorted(HEAVY.intersection(json.loads(ended.stdout))) == []
