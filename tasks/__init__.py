"""What Simyard can do, one package a capability: pure modules plus thin Prefect tasks in ``task.py``."""
