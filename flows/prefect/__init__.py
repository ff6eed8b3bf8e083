"""Prefect's side of a run: flows, tasks, parameters, events, workers, server. The shell and the queue may import it."""
