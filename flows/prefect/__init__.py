"""Prefect's side of a run: flows, tasks, parameters, events, workers and server. Whatever imports Prefect is here."""
