"""What `simyard plan` says of a batch, without JAX."""

import subprocess
import sys

from tasks.simulate.preview import engine_plan
from tests.simulate_factory import delivery, pushing


def test_worlds_seeds_and_numbers_add_no_compilation():
    requests = [
        delivery(k, world=f"w/{k % 5}", seed=k, speed=("0.3", "0.6")[k % 2], duration_s=60.0) for k in range(40)
    ]
    plan = engine_plan(requests, 16)
    assert (plan.compilations, plan.chunks, plan.lanes) == (1, 3, 16)
    assert plan.lane_steps_at_most == 40 * 60 * 200


def test_each_pair_of_applications_is_a_program():
    assert engine_plan([delivery(0, world="w"), pushing(1, world="w")], 8).compilations == 2


def test_planning_imports_no_jax():
    modules = "tasks.simulate.chunks, tasks.simulate.devices, tasks.simulate.preview, tasks.simulate.runner"
    subprocess.run([sys.executable, "-c", f"import sys, {modules}; assert 'jax' not in sys.modules"], check=True)
