"""Replays an episode, and makes a failing one smaller. Flows may import it."""
