"""What S3 calls an object's etag: MD5 of its bytes, or of the MD5s of the parts it was sent in.

Amazon S3 user guide, "Checking object integrity"; objects under a key of KMS have etags of another kind.
"""

import hashlib
from pathlib import Path


def is_etag_of(etag: str, file: Path, part_bytes: int) -> bool:
    """Returns whether an etag is that of the file's bytes; False also if it is of a kind that says nothing.

    Args:
        etag: As the server gives it, with or without quotes.
        file: What was sent.
        part_bytes: Size of the parts if it was sent in parts.
    """
    digest, _, parts = etag.strip('"').partition("-")
    if not parts:
        with file.open("rb") as sent:
            return digest == hashlib.file_digest(sent, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
    together = hashlib.md5(usedforsecurity=False)
    count = 0
    with file.open("rb") as sent:
        while part := sent.read(part_bytes):
            together.update(hashlib.md5(part, usedforsecurity=False).digest())
            count += 1
    return (digest, parts) == (together.hexdigest(), str(count))
