"""The Prefect server of a run: chosen, started, ended. The shell and `simyard` import it."""
