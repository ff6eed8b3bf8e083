"""Intervals, tests and counts of episodes: pure numbers. All of tasks.results may import it."""
