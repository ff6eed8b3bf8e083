"""Words that Simyard adds to RoboMaker's lists, such as versions of ROS; RoboMaker's all stay."""

OWN_WORDS: frozenset[str] = frozenset({"Noetic", "Humble", "Jazzy"})


def robomakers_words(words: list[str]) -> list[str]:
    """Returns the words of a list that are RoboMaker's."""
    return [word for word in words if word not in OWN_WORDS]


def robomakers_pattern(pattern: str) -> str:
    """Returns a pattern without the alternatives that are Simyard's own words."""
    return "|".join(robomakers_words(pattern.split("|")))
