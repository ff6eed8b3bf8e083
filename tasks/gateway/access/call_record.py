"""Which calls the log of actions has, and what it says of them."""

import json
import re
from collections.abc import Callable

from tasks.gateway.access.action_log import Action, ActionLog
from tasks.gateway.access.rights import request_arns
from tasks.gateway.door import Call
from tasks.gateway.messages import HttpAnswer, HttpRequest

_DENIED = "AccessDeniedException"
_SAID_KEY = re.compile(r"Credential=([A-Za-z0-9]{1,64})/")


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
