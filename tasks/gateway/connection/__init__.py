"""Connections of clients: how many, how slow, how big, and TLS. The gateway imports it."""
