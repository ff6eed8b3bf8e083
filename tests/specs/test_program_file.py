"""What the first bytes of a program file say of how it starts."""

import pytest

from specs.program_file import HEAD_BYTES, built_for, needed_programs, start_fault


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"#!/bin/sh\nexec\n", ""),
        (b"#! /usr/bin/env python3\n", ""),
        (b"#!/usr/bin/env -S python3 -u\n", ""),
        (b"#!/bin/sh", ""),
        (b"\x7fELF\x02\x01", ""),
        (b"MZ\x00\x90", ""),
        (b"#!/bin/sh\r\n", "ends in CR LF"),
        (b"#!/usr/bin/env python3\r\n", "ends in CR LF"),
        (b"#!/bin/sh" + b" " * HEAD_BYTES, "is longer than the 256 bytes"),
        (b"#! \nexec\n", "names no interpreter"),
        (b"#!/usr/bin/env\n", "env is given no program"),
        (b"#!/usr/bin/env python3 -u\n", "write #!/usr/bin/env -S python3 -u"),
        (b"exec sleep\n", "says not what runs it"),
        (b"", "is empty"),
        (b"\xef\xbb\xbf#!/bin/sh\n", "a byte order mark"),
    ],
)
def test_a_file_that_starts_nowhere_says_why(head: bytes, said: str) -> None:
    told = start_fault(head[:HEAD_BYTES], "run.sh")
    assert told.startswith("run.sh, line 1: " if said else "")
    assert said in told
    assert bool(told) == bool(said)


@pytest.mark.parametrize(
    ("head", "needed"),
    [
        (b"#!/bin/sh -e\n", ("/bin/sh",)),
        (b"#!/usr/bin/env python2\n", ("/usr/bin/env", "python2")),
        (b"#!/usr/bin/env -S A=1 python3 -u\n", ("/usr/bin/env", "python3")),
        (b"#!bin/own\n", ()),
        (b"\x7fELF", ()),
    ],
)
def test_what_a_script_needs_is_read_from_its_first_line(head: bytes, needed: tuple[str, ...]) -> None:
    assert needed_programs(head) == needed


def test_the_processor_of_a_compiled_program_is_known() -> None:
    head = b"\x7fELF\x02\x01" + bytes(12)
    assert [built_for(head + machine) for machine in (b"\x3e\0", b"\xb7\0", b"\x28\0", b"\xf3\0", b"")] == [
        "X86_64",
        "ARM64",
        "ARMHF",
        None,
        None,
    ]
    assert built_for(b"#!/bin/sh\n" + bytes(20)) is None
