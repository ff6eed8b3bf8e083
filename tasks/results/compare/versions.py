"""Which versions of robot applications a batch drove, and the rows of one of them.

Two versions in one table would be paired with those of another table by their turn, whatever they are. So a table that
is compared holds one version of each application. Versions are the same if their bundles are.
"""

from collections.abc import Collection, Mapping

import pyarrow as pa

_SHORTEST_DIGEST, _SHOWN = 8, 12


def versions_driven(rows: pa.Table) -> dict[str, dict[str, str]]:
    """Returns the version that each bundle was asked for as, by its digest, for each robot application."""
    found: dict[str, dict[str, str]] = {}
    columns = rows.select(["robot_application", "robot_digest", "robot_version"])
    for row in columns.group_by(columns.column_names).aggregate([]).to_pylist():
        found.setdefault(row["robot_application"], {})[row["robot_digest"]] = row["robot_version"]
    return found


def ambiguous_versions(driven: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Returns how to name each version of the applications of which there are several; none if all have one.

    A number names a version, unless several of its builds were driven: then the beginning of a digest does.
    """
    names: list[str] = []
    for versions in driven.values():
        labels = list(versions.values())
        if len(versions) > 1:
            names += [
                label if labels.count(label) == 1 else digest[:_SHOWN] for digest, label in sorted(versions.items())
            ]
    return sorted(dict.fromkeys(names))


def version_rows(rows: pa.Table, version: str, digests: Collection[str]) -> pa.Table:
    """Returns the rows of one version; none if the batch did not drive it.

    Args:
        rows: Of a batch.
        version: As the batch asked for it, or the beginning of a digest of at least eight digits.
        digests: Of the bundles that the version's number stands for in the store.
    """
    driven = {digest: label for found in versions_driven(rows).values() for digest, label in found.items()}
    meant = [digest for digest, label in driven.items() if label == version or digest in digests]
    if not meant and len(version) >= _SHORTEST_DIGEST:
        meant = [digest for digest in driven if digest.startswith(version)]
    chosen = set(meant)
    return rows.filter(pa.array([digest in chosen for digest in rows.column("robot_digest").to_pylist()], pa.bool_()))
