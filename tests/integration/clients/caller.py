"""Calls RoboMaker's API by boto3, or by the AWS CLI: whichever Python runs this needs no more than one of them."""

import json
import re
import subprocess
import time
from typing import Any

Answer = dict[str, Any]
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
        self._client = _Cli(endpoint, aws) if aws else _Boto3(endpoint)

    def __call__(self, operation: str, **members: Any) -> Answer:  # noqa: ANN401 - RoboMaker's requests
        """Returns an operation's answer; one that is refused raises Refused."""
        self.called.add(operation)
        return self._client.send(operation, members)

    def ended(self, operation: str, **job: str) -> Answer:
        """Returns what a Describe call answers once its job has ended."""
        return self.until(operation, _ENDED, **job)

    def until(self, operation: str, states: set[str], **job: str) -> Answer:
        """Returns what a Describe call answers once its job is in one of these states."""
        while (answer := self(operation, **job))["status"] not in states:
            assert answer["status"] not in _ENDED, answer
            time.sleep(0.2)
        return answer

    def pages(self, operation: str, member: str) -> list[int]:
        """Returns how many entries each page of a List has, one a page; the SDK's own paginator asks for them."""
        self.called.add(operation)
        return self._client.pages(operation, member)


class _Boto3:
    """Sends by boto3; it retries as it does for everybody."""

    def __init__(self, endpoint: str) -> None:
        import boto3  # noqa: PLC0415 - the CLI's Python has none

        self._client: Any = boto3.client("robomaker", endpoint_url=endpoint)  # pyright: ignore[reportUnknownMemberType]

    def send(self, operation: str, members: Answer) -> Answer:
        try:
            answer = getattr(self._client, _snake(operation))(**members)
        except self._client.exceptions.ClientError as exc:
            error = exc.response["Error"]
            raise Refused(error["Code"], error["Message"]) from exc
        answer.pop("ResponseMetadata")
        return answer

    def pages(self, operation: str, member: str) -> list[int]:
        paginator = self._client.get_paginator(_snake(operation))
        return [len(page[member]) for page in paginator.paginate(PaginationConfig={"PageSize": 1})]


class _Cli:
    """Sends by the AWS CLI, a process for each request."""

    def __init__(self, endpoint: str, aws: str) -> None:
        self._command = [aws, "--endpoint-url", endpoint, "--output", "json", "robomaker"]

    def send(self, operation: str, members: Answer) -> Answer:
        done = self._run(operation, "--no-paginate", "--cli-input-json", json.dumps(members))
        return json.loads(done.stdout or "{}")

    def pages(self, operation: str, member: str) -> list[int]:
        """The CLI joins the pages; its log has each request."""
        done = self._run(operation, "--page-size", "1", "--debug")
        requests = len(re.findall(r"Making request for OperationModel", done.stderr))
        entries = json.loads(done.stdout)[member]
        assert requests >= len(entries)
        return [1] * len(entries)

    def _run(self, operation: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
        command = [*self._command, _snake(operation).replace("_", "-"), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return done
        told = re.search(r"An error occurred \((\w+)\) when calling the \w+ operation[^:]*: (.*)", done.stderr)
        assert told, done.stderr
        raise Refused(told[1], told[2])


def _snake(operation: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", operation).lower()
