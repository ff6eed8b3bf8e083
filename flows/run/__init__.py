"""A run of a document: references, events, cancellation, end. Flows and the shell may import it."""
