"""What Simyard can do: a package for each capability, without Prefect. Flows may import it."""
