"""What lists say of the jobs that have ended, kept in a few objects, and marks of all others. docs/decisions/0018."""
