"""What a finished world guarantees, and what became of each wish. Generation may import it."""
