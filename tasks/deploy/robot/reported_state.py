"""The reports that a robot writes to the store; when the store is away, the reports wait and the work goes on.

The log says that the store went away, that it is still away, and that it is back.
"""

import logging
import time

from specs.robomaker.deployment import RobotDeploymentStep
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.states import Desired, Reported
from tasks.storage.base.keys import reported_key
from tasks.storage.base.store import Store, encode_document

_LOG = logging.getLogger(__name__)
_AGAIN_S = 600.0
_PERCENT_INTERVAL_S = 0.5
REASON_CHARACTERS = 1024


def one_line(text: str) -> str:
    """Returns the beginning of a text that somebody else may have written, as it can be logged and reported."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in text[:REASON_CHARACTERS])


class Outage:
    """An outage in the log: an agent tries for days, several times a minute, and few attempts are logged.

    Args:
        what: What cannot be done, such as ``report``.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._kind: type[Exception] | None = None
        self._since_s = 0.0
        self._told_s = 0.0

    def failed(self, exc: Exception) -> None:
        """Logs the first failure, one of another kind, and one every ten minutes."""
        now_s = time.monotonic()
        if self._kind is None:
            self._since_s = now_s
        if self._kind is not type(exc) or now_s - self._told_s >= _AGAIN_S:
            _LOG.warning("cannot %s: %s", self._what, one_line(str(exc)))
            self._told_s = now_s
        self._kind = type(exc)

    def worked(self) -> None:
        """Logs that it is over, if there was a failure."""
        if self._kind is not None:
            _LOG.warning("can %s again after %.0f s", self._what, time.monotonic() - self._since_s)
        self._kind = None


class Reporter:
    """Writes a robot's reported state; the latest one counts, so only that is kept for later."""

    def __init__(self, store: Store, robot: str) -> None:
        self._store = store
        self._key = reported_key(robot)
        self._owed: Reported | None = None
        self._told: Reported | None = None
        self._tried_s = 0.0
        self._outage = Outage("report")

    def tell(self, reported: Reported) -> None:
        """Reports now, or as soon as the store is back."""
        self._owed = reported
        self.flush()

    def tell_percent(self, reported: Reported) -> None:
        """Reports unless there was a report, or an attempt to report, a moment ago."""
        if time.monotonic() - self._tried_s >= _PERCENT_INTERVAL_S:
            self.tell(reported)

    def flush(self) -> bool:
        """Tries to send the waiting report; returns whether none waits any more."""
        if self._owed is None or self._owed == self._told:
            self._owed = None
            return True
        try:
            self._store.put(self._key, encode_document(self._owed))
        except Exception as exc:  # noqa: BLE001 - who answers in the store's place may be anybody: what runs, runs on
            self._outage.failed(exc)
            return False
        finally:
            self._tried_s = time.monotonic()
        self._outage.worked()
        self._told, self._owed = self._owed, None
        return True


class Attempt:
    """One attempt at a desired state, reported step by step to the store and to the agent's log.

    Args:
        reporter: Whom to tell.
        desired: What is attempted.
        boot_id: Which start of the agent this is.
        running_digest: What runs meanwhile, or empty.
    """

    def __init__(self, reporter: Reporter, desired: Desired, boot_id: str, running_digest: str) -> None:
        self._reporter = reporter
        self._what = f"{desired.application} {desired.version} of {desired.deployment}"
        self._began_s: float | None = None
        self._latest = Reported(
            robot=desired.robot,
            deployment=desired.deployment,
            sequence=desired.sequence,
            boot_id=boot_id,
            status="Deploying",
            step="Validating",
            running_digest=running_digest,
            started_at_s=time.time(),
        )

    def at(self, step: RobotDeploymentStep) -> None:
        """Reports that a step begins, and that the step before it is done."""
        self._log_end("is done")
        self._began_s = time.monotonic()
        _LOG.info("%s: %s begins", self._what, step)
        self._latest = self._latest.model_copy(update={"step": step})
        self._reporter.tell(self._latest)

    def percent(self, percent: float) -> None:
        """Reports how much of the current step is done, from 0 to 100, at most twice a second."""
        self._latest = self._latest.model_copy(update={"percent_done": percent})
        self._reporter.tell_percent(self._latest)

    def succeeded(self, digest: str) -> Reported:
        """Returns the report that ends the attempt well; the caller reports it once it is on the disk."""
        self._log_end("is done")
        _LOG.info("%s runs", self._what)
        change = {"status": "InSync", "step": "Finished", "percent_done": 100.0, "running_digest": digest}
        return self._latest.model_copy(update={**change, "finished_at_s": time.time()})

    def failed(self, code: DeploymentJobErrorCode, reason: str) -> Reported:
        """Returns the report that ends the attempt badly, at the step where it is."""
        self._log_end("failed")
        change = {"status": "Failed", "failure_code": code, "failure_reason": one_line(reason)}
        return self._latest.model_copy(update={**change, "finished_at_s": time.time()})

    def _log_end(self, how: str) -> None:
        if self._began_s is not None:
            _LOG.info("%s: %s %s after %.1f s", self._what, self._latest.step, how, time.monotonic() - self._began_s)
        self._began_s = None
