"""Episodes as Arrow tables: nothing in them depends on the store, the machine or the hour."""

import math
from collections.abc import Sequence

import pyarrow as pa

from specs.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from tasks.results.schema import FAILURES, MEASURED, RESULTS, SWEEP_PREFIX, sweep_field
from tasks.results.success import paired, reason, success

_MEASURES = tuple(field.name for field in MEASURED)
_Row = dict[str, object]


def results_table(batch_id: str, requests: Sequence[EpisodeRequest], results: Sequence[EpisodeResult]) -> pa.Table:
    """Returns a row an episode in the order of their indices, with the columns of ``RESULTS`` and the sweep's.

    Raises:
        ValueError: The requests and results do not pair up.
    """
    episodes = paired(requests, results)
    variables = sweep_variables(requests)
    rows = [_row(batch_id, request, result, variables) for request, result in episodes]
    return pa.Table.from_pylist(rows, schema=_extended(RESULTS, variables))


def failures_table(batch_id: str, requests: Sequence[EpisodeRequest], results: Sequence[EpisodeResult]) -> pa.Table:
    """Returns a row an episode that did not pass (canceled ones apart), with the columns of ``FAILURES``.

    Raises:
        ValueError: The requests and results do not pair up.
    """
    failed = [(request, result) for request, result in paired(requests, results) if success(result) is False]
    variables = sweep_variables(requests)
    rows = [_row(batch_id, request, result, variables) | _explanation(result) for request, result in failed]
    return pa.Table.from_pylist(rows, schema=_extended(FAILURES, variables))


def sweep_variables(requests: Sequence[EpisodeRequest]) -> list[str]:
    """Returns the environment variables that are finite numbers in every request that has them, sorted."""
    names = sorted({name for request in requests for name in request.environment})
    values = {name: {request.environment.get(name) for request in requests} - {None} for name in names}
    return [name for name in names if all(_number(value) is not None for value in values[name])]


def _extended(schema: pa.Schema, variables: Sequence[str]) -> pa.Schema:
    for variable in variables:
        schema = schema.append(sweep_field(variable))
    return schema


def _row(batch_id: str, request: EpisodeRequest, result: EpisodeResult, variables: Sequence[str]) -> _Row:
    return {
        "batch": batch_id,
        "job": f"{batch_id}/{request.index}",
        "index": request.index,
        "world": request.world,
        "seed": request.seed,
        **_launch("robot", request.robot),
        **_launch("simulation", request.scenario),
        "environment": sorted(request.environment.items()),
        "duration_s": request.duration_s,
        "failure_behavior": request.failure_behavior,
        "status": result.status,
        "failure_code": result.failure_code,
        "outcome": result.outcome,
        "outcome_reason": result.outcome_reason,
        "success": success(result),
        **{name: getattr(result, name) for name in _MEASURES},
        **{f"{SWEEP_PREFIX}{name}": _number(request.environment.get(name)) for name in variables},
    }


def _launch(prefix: str, launch: ApplicationLaunch) -> _Row:
    return {
        f"{prefix}_application": launch.name,
        f"{prefix}_version": launch.version,
        f"{prefix}_digest": launch.digest,
        f"{prefix}_package": launch.package,
        f"{prefix}_launch_file": launch.launch_file,
    }


def _explanation(result: EpisodeResult) -> _Row:
    t_s, x_m, y_m, yaw_rad = zip(*result.trajectory, strict=True) if result.trajectory else ((), (), (), ())
    return {
        "reason": reason(result),
        "failure_reason": result.failure_reason,
        "trajectory_t_s": t_s,
        "trajectory_x_m": x_m,
        "trajectory_y_m": y_m,
        "trajectory_yaw_rad": yaw_rad,
    }


def _number(text: str | None) -> float | None:
    """Returns the finite number that the text is, or None."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
