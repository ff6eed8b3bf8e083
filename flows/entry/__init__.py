"""What flows take from Prefect and give back: parameters without secrets, states, results. Flows may import it."""
