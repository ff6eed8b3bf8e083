"""What a run would do, and worlds to look at. The shell may import it."""
