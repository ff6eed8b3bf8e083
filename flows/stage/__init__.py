"""The stages of a run as plain functions, without Prefect. Flows and the shell import it."""
