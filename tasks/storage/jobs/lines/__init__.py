"""What lists say of ended jobs, kept in a few objects, and marks of all others. Anyone above storage may import it."""
