from collections.abc import Sequence

class EpisodeBuffer:
    def __init__(
        self,
        *,
        id: int,  # noqa: A002
        seed: int | None,
        observations: object,
        actions: object,
        rewards: Sequence[float],
        terminations: Sequence[bool],
        truncations: Sequence[bool],
    ) -> None: ...
