"""Connections of clients: how many, how slow, how big, and TLS."""
