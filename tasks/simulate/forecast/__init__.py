"""The forecast of a batch: its engine, time and memory before it runs. Flows may import it."""
