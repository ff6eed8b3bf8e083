"""Lanes that a trainer steps: a pool of episodes, rewards, resets in the compiled step. `simyard.gym` imports it."""
