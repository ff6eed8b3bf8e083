"""Data sources of jobs: pinned, cached, mounted. Plan and batch may import it."""
