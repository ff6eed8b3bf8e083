"""A batch's report: one HTML page that loads nothing. Flows may import it."""
