"""The engines and the choice between them. Chunks may import it."""
