"""RoboMaker's operations answered from a store: one table, a module for each family. Only the shell may import it."""
