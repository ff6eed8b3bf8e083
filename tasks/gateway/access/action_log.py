"""Who did what over HTTP: a line for each call that changes something, and for those that are refused."""

import json
import logging
import re
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from threading import Lock
from typing import NamedTuple
from uuid import uuid4

from specs.errors import ObjectNotFound, StoreError
from tasks.gateway.access.guard import Call
from tasks.gateway.access.rights import request_arns
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.keys import actions_key, actions_prefix
from tasks.storage.base.store import Store

_LOG = logging.getLogger(__name__)
_FILE_BYTES = 64 << 10
_LONGEST_TEXT = 256
_MOST_ARNS = 100
_REFUSALS_A_MINUTE = 60
_MINUTE_S = 60
_MOST_WAITING_BYTES = 1 << 20
_DENIED = "AccessDeniedException"
_SAID_KEY = re.compile(r"Credential=([A-Za-z0-9]{1,64})/")


class _Lost(NamedTuple):
    """How many lines were given up while the store was away, and the times of the first and the last of them."""

    lines: int
    first: str
    last: str


class Action(NamedTuple):
    """What is kept of a call.

    Attributes:
        request: The id that the answer has, too.
        key: The id of the access key; of a refused call, the one that it named.
        name: The key's; empty if it is not known.
        client: The address that the call came from.
        operation: Such as ``CreateFleet``; method and path of what is none.
        arns: What it was about.
        status: HTTP's.
        outcome: ``done``, or the code of the error.
    """

    request: str
    key: str
    name: str
    client: str
    operation: str
    arns: Sequence[str]
    status: int
    outcome: str


# A store cannot append, so a gateway writes its file of the hour whole each time, under a name that no other process
# has, and begins another one before that gets dear. A line is in the store before its call is answered. Calls that
# are answered at once share a write.
class ActionLog:
    """Writes the lines of one gateway; several threads may.

    Args:
        store: Where to.
        days: For how many days the lines of all gateways are kept.
        now_s: Seconds since 1970.
    """

    def __init__(self, store: Store, days: int, now_s: Callable[[], float] = time.time) -> None:
        self._store, self._days, self._now_s = store, days, now_s
        self._gateway = uuid4().hex[:12]
        self._turn, self._lock = Lock(), Lock()
        self._waiting: list[bytes] = []
        self._lost: _Lost | None = None
        self._taken = self._written = 0
        self._hour, self._number, self._file = "", 0, b""
        self._swept = ""
        self._minute, self._refusals, self._left_out = 0, 0, 0

    def record(self, action: Action) -> None:
        """Writes a line, and returns once it is in the store.

        Raises:
            StoreError: The store did not take it; the line goes with the next one, while there is room for it.
        """
        self._write(self._line(action))

    def record_refusal(self, action: Action) -> None:
        """Writes a line if there were few in this minute; of the others the next line says how many they were.

        Raises:
            StoreError: The store did not take it; the line goes with the next one.
        """
        with self._lock:
            minute = int(self._now_s() // _MINUTE_S)
            if minute != self._minute:
                self._minute, self._refusals = minute, 0
            self._refusals += 1
            if self._refusals > _REFUSALS_A_MINUTE:
                self._left_out += 1
                return
            left_out, self._left_out = self._left_out, 0
        self._write(self._line(action, left_out))

    def _line(self, action: Action, left_out: int = 0) -> bytes:
        arns = [_short(each) for each in action.arns[:_MOST_ARNS]]
        said = {
            # First, so that lines are sorted by time when they are sorted as texts.
            "time": datetime.fromtimestamp(self._now_s(), UTC).isoformat(timespec="microseconds"),
            "gateway": self._gateway,
            **{name: _short(text) for name, text in action._asdict().items() if isinstance(text, str)},
            "status": action.status,
            "arns": arns,
        }
        if len(action.arns) > len(arns):
            said["arnsLeftOut"] = len(action.arns) - len(arns)
        if left_out:
            said["refusalsLeftOut"] = left_out
        return json.dumps(said).encode() + b"\n"

    def _write(self, line: bytes) -> None:
        with self._lock:
            self._waiting.append(line)
            self._taken += 1
            ticket = self._taken
        with self._turn:
            if ticket <= self._written:  # who had the turn before took it along
                return
            with self._lock:
                lines, upto = b"".join([*self._lost_line(), *self._waiting]), self._taken
                count = len(self._waiting)
            try:
                self._put(lines)
            except StoreError:
                self._give_up_oldest()
                raise
            with self._lock:
                del self._waiting[:count]
                self._lost = None
            self._written = upto

    def _give_up_oldest(self) -> None:
        """Bounds the lines that wait for a store that is away; what was given up is counted for the next line."""
        with self._lock:
            size, lost = sum(map(len, self._waiting)), self._lost
            while size > _MOST_WAITING_BYTES:
                line = self._waiting.pop(0)
                size -= len(line)
                time_of = json.loads(line)["time"]
                lost = _Lost(lost.lines + 1, lost.first, time_of) if lost else _Lost(1, time_of, time_of)
            is_new, self._lost = lost != self._lost, lost
        if lost and is_new:
            _LOG.error("%d lines of the log of actions are lost, %s to %s: the store is away", *lost)

    def _lost_line(self) -> Iterator[bytes]:
        if self._lost:
            count, first, last = self._lost
            said = {"time": last, "gateway": self._gateway, "operation": "", "linesLost": count, "lostSince": first}
            yield json.dumps(said).encode() + b"\n"

    def _put(self, lines: bytes) -> None:
        hour = datetime.fromtimestamp(self._now_s(), UTC).strftime("%Y-%m-%d/%H")
        if hour != self._hour or len(self._file) > _FILE_BYTES:
            self._hour, self._number, self._file = hour, self._number + 1, b""
        day, _, of_day = hour.partition("/")
        file = self._file + lines
        self._store.put(actions_key(day, f"{of_day}-{self._gateway}-{self._number}.jsonl"), file)
        self._file = file
        if day != self._swept:
            self._swept = day
            self._sweep()

    def _sweep(self) -> None:
        oldest = (datetime.fromtimestamp(self._now_s(), UTC) - timedelta(days=self._days)).strftime("%Y-%m-%d")
        try:
            for key in self._store.keys(actions_prefix()):
                if key.split("/")[1] < oldest:
                    self._store.delete(key)
        except StoreError as exc:  # tomorrow again
            _LOG.warning("actions older than %d days were not removed: %s", self._days, exc)


def actions(store: Store, days: int, now_s: float) -> Iterator[str]:
    """Yields the lines of all gateways of a store, oldest first.

    Args:
        store: Where they are.
        days: Of how many days, today's among them.
        now_s: Seconds since 1970.
    """
    today = datetime.fromtimestamp(now_s, UTC)
    for back in reversed(range(days)):
        day = (today - timedelta(days=back)).strftime("%Y-%m-%d")
        lines: list[str] = []
        for key in store.keys(actions_prefix(day)):
            try:
                lines += store.get(key).body.decode(errors="replace").splitlines()
            except ObjectNotFound:  # removed since it was listed
                continue
        yield from sorted(lines)


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."


def record_call(log: ActionLog, call: Call, shown_arn: Callable[[str], str] = str) -> None:
    """Records a call that changes something or was refused; called before it is answered.

    Args:
        log: Where.
        call: What was asked and answered.
        shown_arn: Returns an ARN as clients see it: what a request named has Simyard's own form by now.

    Raises:
        StoreError: The store did not take the line.
    """
    refused = call.caller is None or call.answer.error == _DENIED or (not call.operation and call.answer.status == 403)
    if refused:
        log.record_refusal(_action(call, shown_arn))
    elif call.operation is not None and call.operation.right != "read":
        log.record(_action(call, shown_arn))


def _action(call: Call, shown_arn: Callable[[str], str]) -> Action:
    request, answer, caller = call.request, call.answer, call.caller
    return Action(
        request=request.id,
        key=caller.key if caller else _said_key(request),
        name=caller.name if caller else "",
        client=request.client,
        operation=call.operation.name if call.operation else f"{request.method} {request.raw_path}",
        arns=tuple(map(shown_arn, (*(request_arns(call.document) if call.document else ()), *_made(answer)))),
        status=answer.status,
        outcome=answer.error or ("done" if answer.status < 400 else "refused"),
    )


def _said_key(request: HttpRequest) -> str:
    said = _SAID_KEY.search(next((value for name, value in request.headers if name == "authorization"), ""))
    return said[1] if said else ""


def _made(answer: HttpAnswer) -> tuple[str, ...]:
    """Returns the ARN of what a call made."""
    if answer.status >= 400 or not answer.content_type.startswith("application/json"):
        return ()
    made = json.loads(answer.body or b"{}").get("arn")
    return (made,) if isinstance(made, str) else ()
