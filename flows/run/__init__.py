"""What Prefect is told and asked while a flow runs: tasks, events, artifacts, cancellation. Flows may import it."""
