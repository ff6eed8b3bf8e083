"""A document's nights as a trend: series, changes, and one HTML page that loads nothing. Flows may import it."""
