"""A batch from its steps to its end, looked at again afterwards, and over the nights. Flows may import it."""
