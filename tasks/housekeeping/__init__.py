"""Finds and removes what nobody needs any more, in the store and on this machine. Flows may import it."""
