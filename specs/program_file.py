"""How Linux starts a program file of a bundle, as its first bytes say: a script's interpreter, or a processor (ELF).

What is certain to fail is found before anything runs, by whoever checks a document; a robot names the same causes.
"""

from collections.abc import Mapping

from specs.field_types import Architecture

HEAD_BYTES = 256
"""What the kernel looks at: the first line of a script must not be longer."""
_SCRIPT, _ELF, _BYTE_ORDER_MARK = b"#!", b"\x7fELF", b"\xef\xbb\xbf"
_ENV = "env"
# The machine in an ELF header, elf(5), of the architectures that a bundle may be built for.
_MACHINES: Mapping[int, Architecture] = {0x3E: "X86_64", 0xB7: "ARM64", 0x28: "ARMHF"}


def start_fault(head: bytes, file: str) -> str:
    """Returns why a file that begins so is started nowhere, and what to do; empty if nothing is known to be wrong.

    Args:
        head: Its first bytes, `HEAD_BYTES` at the most.
        file: What to call it, such as ``courier/run.sh``.
    """
    if not head.startswith(_SCRIPT):
        return _no_script(head, file)
    line, end, _ = head.partition(b"\n")
    interpreter, argument = _interpreter(head)
    of_env = interpreter.rpartition("/")[2] == _ENV
    wrong = ""
    if line.endswith(b"\r"):
        wrong = f"ends in CR LF, and the CR counts to the interpreter's name: dos2unix {file}"
    elif not end and len(head) == HEAD_BYTES:
        wrong = f"is longer than the {HEAD_BYTES} bytes that Linux reads of it: name its interpreter shorter"
    elif not interpreter:
        wrong = "names no interpreter: write #!/bin/sh, or what runs it"
    elif of_env and not argument:
        wrong = f"env is given no program: write #!{interpreter} python3, or what runs it"
    elif of_env and " " in argument and not argument.startswith("-"):
        wrong = f"Linux gives {argument!r} to env as one word: write #!{interpreter} -S {argument}"
    return wrong and f"{file}, line 1: {wrong}"


def _no_script(head: bytes, file: str) -> str:
    if head.startswith(_ELF) or (b"\0" in head and head):
        return ""
    if head.startswith(_BYTE_ORDER_MARK):
        return f"{file}, line 1: a byte order mark stands before it: save it as UTF-8 without one"
    what = "is empty" if not head else "says not what runs it"
    return f"{file}, line 1: {what}: begin it with #!/bin/sh, #!/usr/bin/env python3 or the like"


def needed_programs(head: bytes) -> tuple[str, ...]:
    """Returns what must be there for a script to start: its interpreter's path, and the name that env looks up."""
    interpreter, argument = _interpreter(head) if head.startswith(_SCRIPT) else ("", "")
    if not interpreter.startswith("/"):
        return ()  # relative to the bundle
    if interpreter.rpartition("/")[2] != _ENV:
        return (interpreter,)
    words = (word for word in argument.split() if not word.startswith("-") and "=" not in word)
    return (interpreter, *([name] if (name := next(words, "")) else []))


def built_for(head: bytes) -> Architecture | None:
    """Returns the architecture that a compiled program is built for; None for a script, or one that is not known."""
    if not head.startswith(_ELF) or len(head) < 20:
        return None
    return _MACHINES.get(int.from_bytes(head[18:20], "big" if head[5:6] == b"\2" else "little"))


def _interpreter(head: bytes) -> tuple[str, str]:
    """Returns the interpreter of a script, and the one argument that Linux gives it."""
    line = head.removeprefix(_SCRIPT).partition(b"\n")[0].decode(errors="replace").strip(" \t\r")
    interpreter, _, argument = line.replace("\t", " ").partition(" ")
    return interpreter, argument.strip()
