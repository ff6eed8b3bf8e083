"""A sample of a batch's episodes driven again on C MuJoCo. Steps may import it."""
