"""Text of strangers for a terminal, which takes some characters for orders: to move, to erase, to write backwards."""

import re

# What steers a terminal (C0 but tab and newline, C1), turns text around, or cannot be seen: the categories Cc, Cf, Zl,
# Zp and Cs of Unicode 15.
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u0890\u0891\u08e2\u180e\u200b-\u200f"
    "\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff\U000110bd\U000110cd\U00013430-\U0001343f"
    "\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0001\U000e0020-\U000e007f]"
)


def terminal_text(text: str) -> str:
    """Returns a text without the characters that steer a terminal; tabs and ends of lines stay."""
    return _UNSEEN.sub("", text)


def terminal_line(text: str) -> str:
    """Returns a text as one line of a terminal, which nobody takes for several."""
    return " ".join(terminal_text(text).split())


def without_commands(text: str) -> str:
    """Returns a text in which GitHub's runner finds no workflow command, whatever stands before it on its line.

    The runner obeys lines that begin with two colons, after spaces, and ``##[`` wherever it stands.
    """
    return text.replace("::", ": :").replace("##[", "## [")


def terminal_json(text: str) -> str:
    """Returns JSON that means the same, with the characters that steer a terminal written as escapes."""
    return _UNSEEN.sub(lambda found: _escaped(found[0]), text)


def _escaped(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at]:02x}{units[at + 1]:02x}" for at in range(0, len(units), 2))
