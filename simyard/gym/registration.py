"""Registers the environments with Gymnasium, so that `gymnasium.make_vec("simyard/Delivery-v0")` finds them."""

import gymnasium

_SCENARIOS = {"simyard/Delivery-v0": "delivery", "simyard/Coverage-v0": "coverage"}


def register_environments() -> None:
    """Registers an environment for each shipped scenario; a second call does nothing."""
    for name, scenario in _SCENARIOS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="simyard.gym.single_env:SimyardEnv",
                vector_entry_point="simyard.gym.vector_env:SimyardVectorEnv",
                kwargs={"scenario": scenario},
                disable_env_checker=True,
            )
