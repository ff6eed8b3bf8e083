"""Fleets and robots as the store holds them. All of tasks.deploy may import it."""
