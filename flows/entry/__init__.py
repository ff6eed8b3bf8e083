"""What flows give back to Prefect: states that say what came of a run, and results. Flows may import it."""
