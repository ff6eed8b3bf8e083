"""What Simyard can do: a package for each capability, Prefect only in its `task.py`. Flows may import it."""
