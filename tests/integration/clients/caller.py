"""Calls RoboMaker's API by boto3, or by the AWS CLI: whichever Python runs this needs no more than one of them."""

import json
import re
import subprocess
import time
from collections.abc import Callable
from typing import Any

Answer = dict[str, Any]
_PATIENCE_S = 400
_ENDED = {"Completed", "PartialFailed", "Failed", "Succeeded", "TimedOut", "Canceled", "Terminated"}


class Refused(Exception):  # noqa: N818 - it is what is expected
    """An operation answered with an error.

    Attributes:
        code: Its name.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(f"{code}: {message}")
        self.code = code


class Caller:
    """Calls operations of one endpoint, and remembers which.

    Args:
        endpoint: The gateway's address.
        aws: The AWS CLI's path; boto3 if empty.
    """

    def __init__(self, endpoint: str, aws: str = "") -> None:
        self.called: set[str] = set()
        self._send = _cli(endpoint, aws) if aws else _boto3(endpoint)

    def __call__(self, operation: str, **members: Any) -> Answer:
        """Returns an operation's answer; one that is refused raises Refused."""
        self.called.add(operation)
        return self._send(operation, members)

    def ended(self, operation: str, **job: str) -> Answer:
        """Returns what a Describe call answers once its job has ended."""
        return self.until(operation, _ENDED, **job)

    def until(self, operation: str, states: set[str], **job: str) -> Answer:
        """Returns what a Describe call answers once its job is in one of these states."""
        until_s = time.monotonic() + _PATIENCE_S
        while (answer := self(operation, **job))["status"] not in states:
            assert answer["status"] not in _ENDED, answer
            assert time.monotonic() < until_s, answer
            time.sleep(0.2)
        return answer

    def pages(self, operation: str, member: str) -> list[int]:
        """Returns how many entries each page of a List has, one a page; the SDK's own paginator asks for them."""
        self.called.add(operation)
        return [len(page[member]) for page in self._send.pages(operation)]  # type: ignore[attr-defined]


def _snake(operation: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", operation).lower()


def _boto3(endpoint: str) -> Callable[[str, Answer], Answer]:
    import boto3  # noqa: PLC0415 - the CLI has none of its own
    from botocore.exceptions import ClientError  # noqa: PLC0415

    client = boto3.client("robomaker", endpoint_url=endpoint)

    def send(operation: str, members: Answer) -> Answer:
        try:
            answer = getattr(client, _snake(operation))(**members)
        except ClientError as exc:
            error = exc.response["Error"]
            raise Refused(error["Code"], error["Message"]) from exc
        answer.pop("ResponseMetadata")
        return answer

    def pages(operation: str) -> Any:
        return client.get_paginator(_snake(operation)).paginate(PaginationConfig={"PageSize": 1})

    send.pages = pages  # type: ignore[attr-defined]
    return send


def _cli(endpoint: str, aws: str) -> Callable[[str, Answer], Answer]:
    def run(operation: str, *arguments: str) -> Any:
        command = [aws, "--endpoint-url", endpoint, "--output", "json", "--cli-read-timeout", "60", "robomaker"]
        named = _snake(operation).replace("_", "-")
        done = subprocess.run([*command, named, *arguments], capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return done
        told = re.search(r"An error occurred \((\w+)\) when calling the \w+ operation[^:]*: (.*)", done.stderr)
        assert told, done.stderr
        raise Refused(told[1], told[2])

    def send(operation: str, members: Answer) -> Answer:
        return json.loads(run(operation, "--no-paginate", "--cli-input-json", json.dumps(members)).stdout or "{}")

    def pages(operation: str) -> Any:
        # The CLI joins the pages; its log has each request.
        done = run(operation, "--page-size", "1", "--debug")
        requests = len(re.findall(r"Making request for OperationModel", done.stderr))
        ((name, entries),) = json.loads(done.stdout).items()
        assert requests >= len(entries) > 0
        return [{name: [entry]} for entry in entries]

    send.pages = pages  # type: ignore[attr-defined]
    return send
