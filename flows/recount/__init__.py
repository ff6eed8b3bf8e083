"""What the owner computes again before a gate is believed and before anything is shipped. Flows may import it."""
