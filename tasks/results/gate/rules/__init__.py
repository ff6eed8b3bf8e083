"""The rules that a gate may have, a module each, and what a rule is. The gate, its evidence and flows may import it."""
