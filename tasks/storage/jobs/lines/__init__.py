"""What lists say of ended jobs, kept in a few objects, and marks of all others. The other job modules import it."""
