"""The gate of a run: what is judged, by which baseline, and what may be shipped. Flows may import it."""
