"""Failure codes: RoboMaker's reasons for which jobs of each kind fail, one list an operation."""

from typing import Literal

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
