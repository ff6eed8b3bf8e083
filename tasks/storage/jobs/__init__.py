"""Job records, claims, runs, cancellation: who works on what. Anyone above storage may import it."""
