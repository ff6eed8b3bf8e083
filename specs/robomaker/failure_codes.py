"""Failure codes: RoboMaker's reasons for which jobs of each kind fail, one list an operation."""

from collections.abc import Mapping
from typing import Literal, get_args

WorldGenerationJobErrorCode = Literal[
    "InternalServiceError",
    "LimitExceeded",
    "ResourceNotFound",
    "RequestThrottled",
    "InvalidInput",
    "AllWorldGenerationFailed",
]
WorldExportJobErrorCode = Literal[
    "InternalServiceError", "LimitExceeded", "ResourceNotFound", "RequestThrottled", "InvalidInput", "AccessDenied"
]
DeploymentJobErrorCode = Literal[
    "ResourceNotFound",
    "EnvironmentSetupError",
    "EtagMismatch",
    "FailureThresholdBreached",
    "RobotDeploymentAborted",
    "RobotDeploymentNoResponse",
    "RobotAgentConnectionTimeout",
    "GreengrassDeploymentFailed",
    "InvalidGreengrassGroup",
    "MissingRobotArchitecture",
    "MissingRobotApplicationArchitecture",
    "MissingRobotDeploymentResource",
    "GreengrassGroupVersionDoesNotExist",
    "LambdaDeleted",
    "ExtractingBundleFailure",
    "PreLaunchFileFailure",
    "PostLaunchFileFailure",
    "BadPermissionError",
    "DownloadConditionFailed",
    "BadLambdaAssociated",
    "InternalServerError",
    "RobotApplicationDoesNotExist",
    "DeploymentFleetDoesNotExist",
    "FleetDeploymentTimeout",
]
RunFailureCode = Literal["Canceled", "TimedOut", "Failed", "InvalidInput"]
"""Of a run of a pipeline whose stage has no code of its own; RoboMaker had no pipelines."""
JobFailureCode = (
    WorldGenerationJobErrorCode | WorldExportJobErrorCode | DeploymentJobErrorCode | RunFailureCode | Literal[""]
)
"""What the record of a job may say, empty for one that has not failed; a batch has InternalServiceError alone."""

_CODES_OF: Mapping[str, object] = {
    "world-generation-job": WorldGenerationJobErrorCode,
    "world-export-job": WorldExportJobErrorCode,
    "simulation-job-batch": Literal["InternalServiceError"],
    "deployment-job": DeploymentJobErrorCode,
}


def require_code_of(kind: str, code: str) -> None:
    """Does nothing for no code, and for one that jobs of a kind may fail with; a run of a pipeline may have any.

    A record with another kind's code would be answered otherwise than it was meant.

    Raises:
        ValueError: Jobs of that kind do not fail with it.
    """
    known = get_args(_CODES_OF.get(kind, Literal[""]))
    if code and kind in _CODES_OF and code not in known:
        raise ValueError(f"{code!r} is no failure code of a {kind}; they are {', '.join(known)}")


def told_code(code: str, codes: object) -> str:
    """Returns a failure code as the answers about a kind of job may have it; another kind's is an internal error.

    A record outlives the version of Simyard that wrote it: whatever it says, its job can be described.

    Args:
        code: What the job's record says.
        codes: Those of the kind, such as `WorldExportJobErrorCode`.
    """
    known = get_args(codes)
    return code if code in known else next(each for each in known if each.startswith("InternalServ"))
