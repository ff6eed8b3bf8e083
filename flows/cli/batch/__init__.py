"""The commands that look at finished batches. Only the shell imports it."""
