"""Rates of worlds that were not drawn, from those that were. The gate, reports and flows may import it."""
