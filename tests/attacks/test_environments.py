"""A wrong environment: no variable of a library changes a verdict, and none is a defect of Simyard.

`python -m tests.attacks.test_environments 500 7` tries so many of a seed, and prints what became of each kind.
"""

import os
import random
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.repository import ROOT

_SEED = 31
_SHOWN = 300
_VALUES = (
    *(
        "",
        "0",
        "1",
        "-1",
        "2",
        "1e99",
        "true",
        "maybe",
        "x y",
        "\u00e9\U0001f916",
        "raise",
        "strict",
        "LOUD",
        "{",
        "a=b",
    ),
    *("/dev/null", "/nowhere/at/all", "http://", "127.0.0.1:1", "http://[::1", "http://127.0.0.1:1", "ftp://here"),
    *("socks5://127.0.0.1:9", "cuda", "--xla_of_no_such_name=1", "--xla_cpu_max_isa=AVX2", "bfloat16", "highest"),
)
_JAX = """
    JAX_PLATFORMS JAX_PLATFORM_NAME JAX_ENABLE_X64 JAX_NUMPY_RANK_PROMOTION JAX_NUMPY_DTYPE_PROMOTION
    JAX_DISABLE_JIT JAX_DEBUG_NANS JAX_DEBUG_INFS JAX_DEFAULT_MATMUL_PRECISION JAX_DEFAULT_PRNG_IMPL
    JAX_THREEFRY_PARTITIONABLE JAX_ENABLE_CUSTOM_PRNG JAX_RANDOM_SEED_OFFSET JAX_DEFAULT_DEVICE JAX_NUM_CPU_DEVICES
    JAX_COMPILATION_CACHE_DIR JAX_ENABLE_COMPILATION_CACHE JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES
    JAX_CPU_COLLECTIVES_IMPLEMENTATION JAX_NO_TRACING JAX_NO_EXECUTION JAX_CHECK_TRACER_LEAKS JAX_ENABLE_CHECKS
    JAX_TRANSFER_GUARD JAX_LOGGING_LEVEL JAX_DUMP_IR_TO JAX_OPTIMIZATION_LEVEL JAX_EXEC_TIME_OPTIMIZATION_EFFORT
    JAX_LOG_COMPILES JAX_TRACEBACK_FILTERING JAX_LEGACY_PRNG_KEY JAX_XLA_BACKEND JAX_MOCK_GPU_TOPOLOGY
    JAX_CUDA_VISIBLE_DEVICES JAX_PGLE_PROFILING_RUNS JAX_ENABLE_PGLE XLA_FLAGS XLA_PYTHON_CLIENT_MEM_FRACTION
    XLA_PYTHON_CLIENT_PREALLOCATE XLA_PYTHON_CLIENT_ALLOCATOR XLA_IR_DEBUG TF_XLA_FLAGS TF_CPP_MIN_LOG_LEVEL
    TF_NUM_INTRAOP_THREADS LIBTPU_INIT_ARGS NPROC OMP_NUM_THREADS OMP_SCHEDULE MKL_NUM_THREADS MKL_CBWR
    OPENBLAS_NUM_THREADS OPENBLAS_CORETYPE NUMBA_DISABLE_JIT NUMBA_CPU_NAME NUMEXPR_NUM_THREADS
    NPY_DISABLE_CPU_FEATURES NPY_PROMOTION_STATE MUJOCO_GL MUJOCO_PLUGIN_DIR PYOPENGL_PLATFORM CUDA_VISIBLE_DEVICES
    CUDA_DEVICE_ORDER ROCR_VISIBLE_DEVICES HIP_VISIBLE_DEVICES NVIDIA_VISIBLE_DEVICES LD_LIBRARY_PATH
    MALLOC_ARENA_MAX PYTHONOPTIMIZE PYTHONWARNINGS PYTHONDONTWRITEBYTECODE PYTHONNOUSERSITE PYTHONBREAKPOINT TZ LANG
    LC_ALL LANGUAGE JAXTYPING_DISABLE BEARTYPE_IS_BEAR EQX_ON_ERROR TMPDIR SIMYARD_PROGRAMS SIMYARD_STEP_LIMIT_S
    SIMYARD_IMPORT_LIMIT_S SIMYARD_CONFINEMENT SIMYARD_ROS_PYTHON ROS_ROOT SIMYARD_LOG_FORMAT HTTP_PROXY ALL_PROXY
    COLUMNS TERM NO_COLOR
"""
_PLAIN = """
    HOME XDG_CACHE_HOME XDG_CONFIG_HOME XDG_STATE_HOME TMPDIR COLUMNS LINES TERM FORCE_COLOR NO_COLOR LANG LC_ALL
    PYTHONWARNINGS PYTHONOPTIMIZE SIMYARD_CACHE SIMYARD_STORE SIMYARD_BUCKETS SIMYARD_KEYS
    SIMYARD_OWNER_KEY SIMYARD_REGION SIMYARD_WORKERS SIMYARD_MAX_WORLDS SIMYARD_MIN_JOB_DURATION SIMYARD_RECOUNT
    SIMYARD_SERVER_WAIT SIMYARD_LOG_FORMAT SIMYARD_CONFINEMENT SIMYARD_ACCESS_FILE JAX_PLATFORMS XLA_FLAGS MUJOCO_GL
    PREFECT_API_URL PREFECT_PROFILE PREFECT_HOME GITHUB_STEP_SUMMARY GITHUB_WORKSPACE ROS_DISTRO AMENT_PREFIX_PATH
    PAGER LESS EDITOR BROWSER SHELL USER LOGNAME HOSTNAME PWD OLDPWD TZ TZDIR TMP TEMP LC_CTYPE LC_MESSAGES LC_NUMERIC
    LC_TIME LANGUAGE COLORTERM CLICOLOR TTY_COMPATIBLE TTY_INTERACTIVE RICH_FORCE_TERMINAL _TYPER_STANDARD_TRACEBACK
    TYPER_USE_RICH PYTHONDEVMODE PYTHONUNBUFFERED PYTHONASYNCIODEBUG PYTHONFAULTHANDLER PYTHONNODEBUGRANGES
    PYTHONPYCACHEPREFIX PYTHONCOERCECLOCALE PYTHONSAFEPATH PYTHONDONTWRITEBYTECODE PYTHONSTARTUP
    PYDANTIC_DISABLE_PLUGINS PYDANTIC_ERRORS_INCLUDE_URL ARROW_DEFAULT_MEMORY_POOL ARROW_IO_THREADS OMP_NUM_THREADS
    FSSPEC_CONFIG_DIR FSSPEC_S3_ENDPOINT_URL FSSPEC_FILE MPLBACKEND SCIPY_ARRAY_API NPY_DISABLE_CPU_FEATURES
    GLIBC_TUNABLES MALLOC_ARENA_MAX JAX_ENABLE_X64 CUDA_VISIBLE_DEVICES SSLKEYLOGFILE SIMYARD_DEBUG CI
"""
_AWS = """
    AWS_ENDPOINT_URL AWS_ENDPOINT_URL_S3 AWS_REGION AWS_DEFAULT_REGION AWS_PROFILE AWS_CONFIG_FILE AWS_ACCESS_KEY_ID
    AWS_SECRET_ACCESS_KEY AWS_SESSION_TOKEN AWS_SHARED_CREDENTIALS_FILE AWS_CA_BUNDLE AWS_RETRY_MODE AWS_MAX_ATTEMPTS
    AWS_DEFAULTS_MODE AWS_USE_FIPS_ENDPOINT AWS_USE_DUALSTACK_ENDPOINT AWS_STS_REGIONAL_ENDPOINTS AWS_DATA_PATH
    AWS_S3_US_EAST_1_REGIONAL_ENDPOINT AWS_REQUEST_CHECKSUM_CALCULATION AWS_RESPONSE_CHECKSUM_VALIDATION
    AWS_ROLE_ARN AWS_WEB_IDENTITY_TOKEN_FILE AWS_CONTAINER_CREDENTIALS_FULL_URI AWS_EC2_METADATA_SERVICE_ENDPOINT
    AWS_EC2_METADATA_SERVICE_ENDPOINT_MODE AWS_METADATA_SERVICE_TIMEOUT AWS_METADATA_SERVICE_NUM_ATTEMPTS
    AWS_IGNORE_CONFIGURED_ENDPOINT_URLS AWS_SIGV4A_SIGNING_REGION_SET AWS_ACCOUNT_ID AWS_ACCOUNT_ID_ENDPOINT_MODE
    AWS_SDK_UA_APP_ID AWS_DISABLE_REQUEST_COMPRESSION AWS_S3_USE_ARN_REGION AWS_AUTH_SCHEME_PREFERENCE BOTO_CONFIG
    HTTP_PROXY HTTPS_PROXY ALL_PROXY NO_PROXY http_proxy no_proxy REQUESTS_CA_BUNDLE SSL_CERT_FILE SSL_CERT_DIR
    FSSPEC_S3_KEY FSSPEC_S3_ENDPOINT_URL FSSPEC_S3_CONFIG_KWARGS FSSPEC_CONFIG_DIR AWS_LOGIN_CACHE_DIRECTORY
    AWS_EC2_METADATA_DISABLED AWS_EC2_METADATA_V1_DISABLED AWS_CONTAINER_CREDENTIALS_RELATIVE_URI AWS_CA_BUNDLE
    AWS_CONTAINER_AUTHORIZATION_TOKEN AWS_S3_DISABLE_MULTIREGION_ACCESS_POINTS AWS_USER_AGENT_APP_ID
"""
_PREFECT = """
    PREFECT_PROFILE PREFECT_PROFILES_PATH PREFECT_LOGGING_LEVEL PREFECT_LOGGING_SETTINGS_PATH PREFECT_LOGGING_COLORS
    PREFECT_LOGGING_EXTRA_LOGGERS PREFECT_LOGGING_TO_API_ENABLED PREFECT_CLIENT_MAX_RETRIES PREFECT_API_ENABLE_HTTP2
    PREFECT_CLIENT_METRICS_PORT PREFECT_CLIENT_RETRY_JITTER_FACTOR PREFECT_CLIENT_CUSTOM_HEADERS
    PREFECT_API_REQUEST_TIMEOUT
    PREFECT_API_SSL_CERT_FILE PREFECT_API_TLS_INSECURE_SKIP_VERIFY PREFECT_API_KEY PREFECT_API_URL PREFECT_HOME
    PREFECT_RESULTS_DEFAULT_SERIALIZER PREFECT_RESULTS_PERSIST_BY_DEFAULT PREFECT_DEFAULT_RESULT_STORAGE_BLOCK
    PREFECT_RESULTS_LOCAL_STORAGE_PATH PREFECT_FLOWS_DEFAULT_RETRIES PREFECT_TASKS_REFRESH_CACHE PREFECT_CLOUD_API_URL
    PREFECT_TASKS_DEFAULT_RETRY_DELAY_SECONDS PREFECT_TASKS_RUNNER_THREAD_POOL_MAX_WORKERS PREFECT_TEST_MODE
    PREFECT_DEBUG_MODE PREFECT_SILENCE_INTERNAL_ERRORS PREFECT_SERVER_WAIT ALL_PROXY HTTP_PROXY HTTPS_PROXY NO_PROXY
"""
# Not among them: what ends Python itself before Simyard is there, such as PYTHONHOME, PYTHONHASHSEED, PYTHONIOENCODING.
# What needs no server, no bucket, and no more than a second or two.
_DOCUMENT = """
name: tried
worldGeneration:
  template: {template}
  worldCount: {{floorplanCount: 1}}
  seed: 7
simulationBatch:
  outputLocation: {{s3Bucket: results}}
  matrix: {{worlds: all, seeds: 2}}
  createSimulationJobRequests:
    - maxJobDurationInSeconds: 90
      robotApplications: [{{application: courier, launchConfig: {{packageName: courier, launchFile: go_to_goal}}}}]
      simulationApplications: [{{application: delivery, launchConfig: {{packageName: delivery, launchFile: rooms}}}}]
gate: {{successRate: {{atLeast: 0.01, confidence: 0.5}}}}
"""
_SETTINGS = """
from flows.cli.terminal import exit_with_code
from flows.prefect.prefect_server import known_server, require_prefect_settings
with exit_with_code(), known_server():
    require_prefect_settings()
"""


class Attempt(NamedTuple):
    """A command in an environment of its own."""

    command: str
    variable: str
    value: str


# Nothing answers there.
_GIVEN = {
    "s3": {"AWS_ENDPOINT_URL": "http://127.0.0.1:1", "AWS_ACCESS_KEY_ID": "id", "AWS_SECRET_ACCESS_KEY": "secret"},
    "prefect": {"PREFECT_API_URL": "http://127.0.0.1:1/api"},
}
_COMMANDS: Mapping[str, tuple[str, int]] = {
    "run": (_JAX, 2),
    "plan": (_JAX + _PLAIN, 8),
    "validate": (_PLAIN, 3),
    "s3": (_AWS, 5),
    "prefect": (_PREFECT, 4),
}


def attempts(seed: int, count: int) -> Iterator[Attempt]:
    """Yields so many attempts, each variable with each value at most once."""
    drawn = random.Random(seed)  # noqa: S311 - no secret
    shares = [command for command, (_, share) in _COMMANDS.items() for _ in range(share)]
    seen = set[Attempt]()
    while len(seen) < count:
        command = shares[len(seen) % len(shares)]
        found = Attempt(command, drawn.choice(_COMMANDS[command][0].split()), drawn.choice(_VALUES))
        if found not in seen:
            seen.add(found)
            yield found


def outcome(attempt: Attempt, folder: Path) -> tuple[int, str]:
    """Returns the exit code of an attempt, and what it printed."""
    folder.mkdir()
    document = folder / "document.yaml"
    document.write_text(_DOCUMENT.format(template=ROOT / "examples/templates/two-rooms.json"))
    store = ["--store", (folder / "store").as_uri()]
    simyard = [sys.executable, "-m", "simyard"]
    commands: Mapping[str, Sequence[str]] = {
        "run": [*simyard, "run", str(document), "--direct", *store],
        "plan": [*simyard, "plan", str(document), *store],
        "validate": [*simyard, "validate", str(document)],
        "s3": [*simyard, "list", "worlds", "--store", "s3://bucket/prefix"],
        "prefect": [sys.executable, "-c", _SETTINGS],
    }
    own = {**os.environ, "PYTHONPATH": str(ROOT), **_GIVEN.get(attempt.command, {}), attempt.variable: attempt.value}
    done = subprocess.run(commands[attempt.command], env=own, cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def wrong(attempt: Attempt, code: int, said: str) -> str:
    """Returns what is wrong with an outcome; empty for any other day's verdict, or the environment's fault."""
    if "defect of Simyard" in said or "Traceback" in said:
        return "a defect"
    allowed = {0, 2, 3} if attempt.command != "s3" else {2, 3}
    return "" if code in allowed else f"exit code {code}"


@pytest.mark.long
@pytest.mark.integration
def test_no_environment_changes_a_verdict_or_is_a_defect(tmp_path: Path):
    tried = list(attempts(_SEED, 24))
    found = [(each, *outcome(each, tmp_path / str(number))) for number, each in enumerate(tried)]
    assert [(each, why, said[-_SHOWN:]) for each, code, said in found if (why := wrong(each, code, said))] == []
    assert {code for _, code, _ in found} >= {0, 2, 3}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as home, ThreadPoolExecutor(2) as pool:
        all_of_them = list(attempts(int(sys.argv[2]), int(sys.argv[1])))
        places = [Path(home) / str(number) for number in range(len(all_of_them))]
        counts = Counter[str]()
        for each, (code, said) in zip(all_of_them, pool.map(outcome, all_of_them, places), strict=True):
            why = wrong(each, code, said)
            counts[f"{each.command} {why or code}"] += 1
            if why:
                print(each, why, said[-_SHOWN:].strip(), flush=True)  # noqa: T201 - a program's
        for kind, number in sorted(counts.items()):
            print(f"{number:5} {kind}")  # noqa: T201 - same
