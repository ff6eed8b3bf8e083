"""What the process that runs applications is given: the variables of one table, with values that mean something."""

import re
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.simulate.sandbox.process_environment import (
    FAMILIES,
    FIXED,
    PASSED,
    left_out,
    process_environment,
    require_environment,
)
from tests.repository import ROOT

PROGRAMS = Path("/programs")
SECRETS = {
    "SIMYARD_KEYS": "keys",
    "SIMYARD_OWNER_KEY": "key",
    "SIMYARD_STORE": "s3://bucket",
    "AWS_SECRET_ACCESS_KEY": "secret",
    "PREFECT_API_AUTH_STRING": "admin:password",
}
# Each decides numbers, or whether there are any, where a process reads it.
DECIDING = {
    "JAX_ENABLE_X64": "1",
    "JAX_NUMPY_RANK_PROMOTION": "raise",
    "JAX_NUMPY_DTYPE_PROMOTION": "strict",
    "JAX_DISABLE_JIT": "1",
    "JAX_DEFAULT_MATMUL_PRECISION": "bfloat16",
    "TF_XLA_FLAGS": "--gone",
    "OMP_NUM_THREADS": "0",
    "MKL_CBWR": "COMPATIBLE",
    "NUMBA_DISABLE_JIT": "1",
    "NPY_DISABLE_CPU_FEATURES": "AVX2",
    "PYTHONOPTIMIZE": "2",
    "PYTHONSTARTUP": "/own.py",
    "LD_PRELOAD": "/own.so",
}


def test_neither_secrets_nor_what_decides_numbers_reaches_a_simulation():
    given = process_environment({**SECRETS, **DECIDING, "PATH": "/usr/bin", "LC_ALL": "C"}, PROGRAMS)
    assert not given.keys() & (SECRETS.keys() | DECIDING.keys())
    assert (given["PATH"], given["LC_ALL"]) == ("/usr/bin", "C")


def test_what_is_fixed_wins_over_the_users_own():
    own = {
        "PYTHONHASHSEED": "7",
        "OPENBLAS_NUM_THREADS": "2",
        "HOME": "/home/owner",
        "JAX_COMPILATION_CACHE_DIR": "/of/the/run",
    }
    given = process_environment(own, PROGRAMS)
    assert {name: given[name] for name in own} == {
        "PYTHONHASHSEED": FIXED["PYTHONHASHSEED"][0],
        "OPENBLAS_NUM_THREADS": "1",
        "HOME": FIXED["HOME"][0],
        "JAX_COMPILATION_CACHE_DIR": str(PROGRAMS),
    }


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("JAX_PLATFORMS", "cpu"),
        ("XLA_FLAGS", "--xla_force_host_platform_device_count=2 --xla_cpu_max_isa=SSE4_2"),
        ("CUDA_VISIBLE_DEVICES", ""),
        ("CUDA_VISIBLE_DEVICES", "0,1"),
        ("CUDA_VISIBLE_DEVICES", "0, 1"),
        ("NVIDIA_VISIBLE_DEVICES", "nvidia.com/gpu=all"),
        ("NVIDIA_DRIVER_CAPABILITIES", "compute, utility"),
        ("XLA_PYTHON_CLIENT_PREALLOCATE", "False"),
        ("CUDA_VISIBLE_DEVICES", "GPU-8932f937-d72c-4106-c12f-20bd9faed9f6"),
        ("XLA_PYTHON_CLIENT_MEM_FRACTION", ".75"),
        ("MUJOCO_GL", "egl"),
        ("SIMYARD_STEP_LIMIT_S", "3"),
    ],
)
def test_where_a_simulation_runs_is_the_users_right(name: str, value: str):
    require_environment({name: value})
    assert process_environment({name: value}, PROGRAMS)[name] == value


@pytest.mark.parametrize("name", ["MUJOCO_GL", "XLA_FLAGS"])
def test_what_is_set_to_nothing_is_as_good_as_not_set(name: str):
    assert process_environment({name: ""}, PROGRAMS) == process_environment({}, PROGRAMS)


@pytest.mark.parametrize(
    ("name", "value", "named"),
    [
        ("XLA_FLAGS", "--xla_cpu_max_isa=AVX --xla_gone=1", "--xla_gone=1"),
        ("XLA_FLAGS", "--xla_cpu_max_isa=AVX --xla_cpu_max_isa=AVX2", "--xla_cpu_max_isa=AVX2"),
        ("XLA_FLAGS", "/a/file/of/flags", "/a/file/of/flags"),
        ("JAX_PLATFORMS", "metal", "metal"),
        ("JAX_PLATFORMS", "cuda", "cuda"),
        ("XLA_PYTHON_CLIENT_MEM_FRACTION", "0.0", "0.0"),
        ("MUJOCO_GL", "nonsense", "nonsense"),
        ("CUDA_VISIBLE_DEVICES", "first", "first"),
    ],
)
def test_a_value_that_means_nothing_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, named: str
):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)  # no plugin of a GPU
    with pytest.raises(DocumentError, match=rf"environment variable {name}: '{re.escape(named)}': .*unset it"):
        require_environment({name: value})


def test_all_such_values_are_told_at_once():
    with pytest.raises(DocumentError) as refused:
        require_environment({"MUJOCO_GL": "no", "XLA_FLAGS": "no", "JAX_ENABLE_X64": "1"})
    assert len(refused.value.faults) == 2


def test_a_user_hears_which_settings_of_libraries_do_not_reach_a_simulation():
    assert left_out({**DECIDING, "JAX_PLATFORMS": "cpu", "HOME": "/"}) == sorted(
        name for name in DECIDING if name.startswith(FAMILIES)
    )


@pytest.mark.parametrize(("threads", "expected"), [("2", ["OPENBLAS_NUM_THREADS"]), ("1", [])])
def test_a_variable_with_the_value_of_each_simulation_is_not_told(threads: str, expected: list[str]):
    assert FIXED["OPENBLAS_NUM_THREADS"][0] == "1"
    assert left_out({"OPENBLAS_NUM_THREADS": threads}) == expected


def test_the_page_of_settings_has_the_table():
    page = (ROOT / "docs/operate/operations.md").read_text()
    section = page.partition("### What a simulation gets")[2]
    rows = re.findall(r"^\| `(\S+)` \| (?:`(\S+)` \| )?(.*?) \|$", section, flags=re.MULTILINE)
    assert rows == [(each.name, "", each.why) for each in PASSED] + [
        (name, value, why) for name, (value, why) in FIXED.items()
    ]
