"""What every store is and how its objects are named and written. Anyone may import it."""
