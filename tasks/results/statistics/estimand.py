"""What a rate is a rate of, in words.

A rate that was measured in eight worlds is the rate in these eight, with other seeds. What it is in worlds like them is
another question, with a wider interval. Wherever an interval stands, one of these phrases stands beside it.
"""


def in_worlds(worlds: int, *, like_these: bool = False) -> str:
    """Returns where a rate holds, such as ``in these 8 worlds``.

    Args:
        worlds: How many worlds its episodes were in.
        like_these: Whether its interval is of worlds like these, and not of these alone.
    """
    if worlds < 1:
        return "in no world"
    if like_these:
        return f"in worlds like {'this 1' if worlds == 1 else f'these {worlds:,}'}"
    return "in this 1 world" if worlds == 1 else f"in these {worlds:,} worlds"
