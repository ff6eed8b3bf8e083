"""Why a world could not be made."""

from specs.errors import SimyardError
from specs.robomaker.failure_codes import WorldGenerationJobErrorCode


class WorldRejected(SimyardError):  # noqa: N818 - a state, like StageFailed
    """A world cannot be generated; a job records it and goes on with the next.

    Attributes:
        code: RoboMaker's WorldGenerationJobErrorCode.
        reason: What stands in the way, for a person.
    """

    def __init__(self, code: WorldGenerationJobErrorCode, reason: str) -> None:
        self.code: WorldGenerationJobErrorCode = code
        self.reason = reason
        super().__init__(f"{code}: {reason}")
