import gymnasium
from minari.data_collector import EpisodeBuffer

class MinariDataset: ...

def create_dataset_from_buffers(
    dataset_id: str,
    buffer: list[EpisodeBuffer],
    *,
    observation_space: gymnasium.Space[object],
    action_space: gymnasium.Space[object],
    algorithm_name: str,
    description: str,
    data_format: str,
) -> MinariDataset: ...
