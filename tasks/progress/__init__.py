"""Progress of a stage, for the terminal and Prefect. Capabilities and flows may import it."""
