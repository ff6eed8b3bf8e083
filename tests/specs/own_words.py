"""Words that Simyard adds to RoboMaker's lists, such as furniture types and failure codes; RoboMaker's all stay."""

OWN_WORDS: frozenset[str] = frozenset()


def robomakers_words(words: list[str]) -> list[str]:
    """Returns the words of a list that are RoboMaker's."""
    return [word for word in words if word not in OWN_WORDS]
