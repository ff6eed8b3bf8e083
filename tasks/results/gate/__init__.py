"""The gate, its rules, and the evidence. Report and flows may import it."""
