"""Episodes as Arrow tables, column by column: nothing in them depends on the store, the machine or the hour."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import pyarrow as pa

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from tasks.results.statistics.success import paired, reason, success
from tasks.results.tables.columns import FAILURES, MEASURED, RESULTS, SWEEP_PREFIX, sweep_field

_MEASURES = tuple(field.name for field in MEASURED)
_Values = Sequence[object]
_Columns = dict[str, _Values]


def results_table(
    batch_id: str,
    requests: Sequence[EpisodeRequest],
    results: Sequence[EpisodeResult],
    variables: Sequence[str] = (),
) -> pa.Table:
    """Returns a row an episode in the order of their indices, with the columns of ``RESULTS`` and the sweep's.

    Args:
        batch_id: The batch.
        requests: Episodes of it.
        results: One for each request, in any order.
        variables: Environment variables that get a column of their own (`sweep_variables`).

    Raises:
        ValueError: The requests and results do not pair up.
    """
    asked, answered = _split(paired(requests, results))
    columns = _requested(batch_id, asked, variables) | _answered(answered)
    return _table(columns, _extended(RESULTS, variables))


def failures_table(
    batch_id: str,
    requests: Sequence[EpisodeRequest],
    results: Sequence[EpisodeResult],
    variables: Sequence[str] = (),
) -> pa.Table:
    """Returns a row an episode that did not pass (canceled ones apart), with the columns of ``FAILURES``.

    Args:
        batch_id: The batch.
        requests: Episodes of it.
        results: One for each request, in any order.
        variables: As for `results_table`.

    Raises:
        ValueError: The requests and results do not pair up.
    """
    failed = [(request, result) for request, result in paired(requests, results) if success(result) is False]
    asked, answered = _split(failed)
    columns = _requested(batch_id, asked, variables) | _answered(answered) | _explained(answered)
    return _table(columns, _extended(FAILURES, variables))


def sweep_variables(variables: Mapping[str, Iterable[str | None]]) -> list[str]:
    """Returns the environment variables that are finite numbers in every request that has them, sorted.

    Args:
        variables: The values that each takes in a batch; None where an episode does not set it.
    """
    return [
        name
        for name in sorted(variables)
        if all(_number(value) is not None for value in variables[name] if value is not None)
    ]


def extended_schemas(variables: Sequence[str]) -> tuple[pa.Schema, pa.Schema]:
    """Returns the schemas of results and failures with a column for each of the variables."""
    return _extended(RESULTS, variables), _extended(FAILURES, variables)


def _extended(schema: pa.Schema, variables: Sequence[str]) -> pa.Schema:
    for variable in variables:
        schema = schema.append(sweep_field(variable))
    return schema


def _table(columns: Mapping[str, _Values], schema: pa.Schema) -> pa.Table:
    return pa.table([pa.array(columns[field.name], type=field.type) for field in schema], schema=schema)


def _split(
    episodes: Sequence[tuple[EpisodeRequest, EpisodeResult]],
) -> tuple[list[EpisodeRequest], list[EpisodeResult]]:
    return [request for request, _ in episodes], [result for _, result in episodes]


def _requested(batch_id: str, requests: Sequence[EpisodeRequest], variables: Sequence[str]) -> _Columns:
    environments = [request.environment for request in requests]
    return {
        "batch": [batch_id] * len(requests),
        "job": [f"{batch_id}/{request.index}" for request in requests],
        "index": [request.index for request in requests],
        "world": [request.world for request in requests],
        "seed": [request.seed for request in requests],
        **_launches("robot", [request.robot for request in requests]),
        **_launches("simulation", [request.scenario for request in requests]),
        "environment": [sorted(environment.items()) for environment in environments],
        "duration_s": [request.duration_s for request in requests],
        "failure_behavior": [request.failure_behavior for request in requests],
        **{f"{SWEEP_PREFIX}{name}": [_number(each.get(name)) for each in environments] for name in variables},
    }


def _launches(prefix: str, launches: Sequence[ApplicationLaunch]) -> _Columns:
    return {
        f"{prefix}_application": [launch.name for launch in launches],
        f"{prefix}_version": [launch.version for launch in launches],
        f"{prefix}_digest": [launch.digest for launch in launches],
        f"{prefix}_package": [launch.package for launch in launches],
        f"{prefix}_launch_file": [launch.launch_file for launch in launches],
    }


def _answered(results: Sequence[EpisodeResult]) -> _Columns:
    return {
        "status": [result.status for result in results],
        "failure_code": [result.failure_code for result in results],
        "outcome": [result.outcome for result in results],
        "outcome_reason": [result.outcome_reason for result in results],
        "success": [success(result) for result in results],
        "engine": [result.engine for result in results],
        "device": [result.device for result in results],
        "recording": [result.recording for result in results],
        **{name: [getattr(result, name) for result in results] for name in _MEASURES},
    }


def _explained(results: Sequence[EpisodeResult]) -> _Columns:
    return {
        "reason": [reason(result) for result in results],
        "failure_reason": [result.failure_reason for result in results],
        "trajectory_t_s": _poses(results, lambda pose: pose[0]),
        "trajectory_x_m": _poses(results, lambda pose: pose[1]),
        "trajectory_y_m": _poses(results, lambda pose: pose[2]),
        "trajectory_yaw_rad": _poses(results, lambda pose: pose[3]),
    }


def _poses(
    results: Sequence[EpisodeResult], part: Callable[[tuple[float, float, float, float]], float]
) -> list[list[float]]:
    return [[part(pose) for pose in result.trajectory] for result in results]


def _number(text: str | None) -> float | None:
    """Returns the finite number that the text is, or None."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
