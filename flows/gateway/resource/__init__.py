"""Calls about resources that are no jobs, and about the tags of any. Only flows.gateway imports it."""
