"""Why a world could not be made."""

from typing import Literal

from specs.errors import SimyardError

FailureCode = Literal[
    "InternalServiceError",
    "LimitExceeded",
    "ResourceNotFound",
    "RequestThrottled",
    "InvalidInput",
    "AllWorldGenerationFailed",
]


class WorldRejected(SimyardError):  # noqa: N818 - a state, like StageFailed
    """A world cannot be generated; a job records it and goes on with the next.

    Attributes:
        code: RoboMaker's WorldGenerationJobErrorCode.
        reason: What stands in the way, for a person.
    """

    def __init__(self, code: FailureCode, reason: str) -> None:
        self.code: FailureCode = code
        self.reason = reason
        super().__init__(f"{code}: {reason}")
