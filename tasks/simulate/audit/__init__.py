"""A sample of a batch's episodes driven again on C MuJoCo. task.py may import it."""
