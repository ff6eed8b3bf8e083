"""What a store and a machine keep that nobody names any more: found, told, and removed."""
