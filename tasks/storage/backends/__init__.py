"""The stores: a folder, a bucket of an S3 server, an overlay in memory.

Only tasks.storage.store_url and the shell open them.
"""
