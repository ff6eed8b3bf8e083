"""Jobs that wait in the store, worked off by a process that stays. Only the shell may import it."""
