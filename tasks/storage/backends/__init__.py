"""The stores: a folder, a bucket of an S3 server, an overlay in memory. store_url and the shell may import it."""
