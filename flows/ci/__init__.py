"""A run as CI is told of it: its whole report from the records, and the files. Only the shell imports it."""
