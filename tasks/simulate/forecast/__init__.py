"""What a batch will need, said before it runs. Flows may import it."""
