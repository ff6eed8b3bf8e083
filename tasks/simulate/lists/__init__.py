"""Lists of batches and of their jobs, in pages. Flows import it."""
