"""A batch before and after its simulation: early end, report, replay, shrink, compare. Flows may import it."""
