"""Every exception that Simyard raises on purpose.

SimyardError
├── DocumentError                     the document is wrong: exit code 2
│   ├── ConcurrentDeployment          the fleet has an active deployment already
│   ├── IdempotentParameterMismatch   same token, another request
│   ├── LimitExceeded                 one more than there may be
│   ├── ResourceAlreadyExists         the name is taken
│   ├── ResourceNotFound              a document names something that does not exist
│   └── SourceError                   a file is no world that can be imported (declared where it is raised)
├── AccessRefused                     a request over HTTP is not let in: who sent it, or what its key may do
├── BundleRefused                     an archive is not what its digest says, or would write where it must not
├── LaunchRefused                     a ROS launch file cannot be run here, or roslaunch refuses it
├── PipelineNotPassed                 the gate said FAIL, or the deployment failed: exit code 1; INCONCLUSIVE: 4
├── StageFailed                       a stage ended Failed, with RoboMaker's code and a reason: exit code 3
├── TrustRefused                      signed metadata or a desired state is not what the keys vouch for
│   └── TrustExpired                  it was, but has expired by this machine's clock
├── WorldChanged                      a world has another SHA-256 than it had
├── StoreError                        the store could not do it: exit code 3
│   ├── StoreUnreachable              no answer, or no such place
│   │   ├── BucketNotFound            the server answers, and has no such bucket
│   │   └── StoreAway                 no answer now: the same request may succeed in a minute
│   │       └── StoreThrottled        the store asks to be asked less often
│   ├── StoreFull                     no room: a full disk, a quota, an object that is too big for the store
│   ├── StoreDamaged                  what arrived is not what was sent
│   ├── StoreUnsafe                   answers, but ignores conditions on writes
│   ├── StoreAccessDenied             answers, and refuses
│   ├── ObjectNotFound                no object under that key
│   ├── ObjectCorrupt                 an object is not what Simyard writes there
│   ├── ObjectTooBig                  more bytes than whoever reads it reckons with
│   ├── ObjectExists                  create: somebody else was first
│   └── ObjectConflict                compare-and-swap: the object has changed
├── WorldRejected                     a world cannot be generated; its job goes on      (these ten are declared
├── WorkerDied                        a process that makes worlds ended                  where they are raised)
├── RobotRefused                      a robot.xml does not load, or no engine can represent it
│   └── MjcfRefused                   a robot.xml leads out of its bundle, or grows beyond any robot
├── BundleCrash                       an application's own code failed
├── DrawingFailed                     no GL is there, or it ends or hangs: this machine is to blame
├── SimulatorEnded                    the process that simulates ended before it answered
├── SimulatorNotStarted               it ended before it could import an application: this machine is to blame
├── MessageRefused                    that process sent a message of no known form
└── JaxAlreadyImported                JAX was imported before its devices were set

All of them survive the way from a worker's process: pickled and read again, an error is the same.
"""

from collections.abc import Callable, Sequence
from typing import Self, TypeVar

from specs.base import Fault
from specs.data.run_report import PipelineReport


class SimyardError(Exception):
    """The root of the tree: catching it catches what Simyard can explain, and nothing else."""

    def __reduce__(self) -> "tuple[object, ...]":
        """Returns what it is made of again in another process: its text and its fields, and not what it was made of."""
        return _restored_error, (type(self), self.args, vars(self))


def _restored_error(kind: type[SimyardError], args: tuple[object, ...], fields: dict[str, object]) -> SimyardError:
    error = kind.__new__(kind, *args)
    vars(error).update(fields)
    return error


NO_SOURCE = "document"
"""What is at fault where nobody has said which document it is, as in a command that takes none."""


class DocumentError(SimyardError):
    """A document is refused; carries all its faults, not the first one."""

    def __init__(self, faults: Sequence[Fault], source: str = NO_SOURCE) -> None:
        self.faults = tuple(faults)
        self.source = source
        plural = "" if len(self.faults) == 1 else "s"
        lines = "".join(f"\n  {fault}" for fault in self.faults)
        super().__init__(f"{source}: {len(self.faults)} fault{plural}{lines}")

    @classmethod
    def of(cls, path: str, value: str, allowed: str, source: str = NO_SOURCE) -> Self:
        """Returns the refusal of a document that has one fault.

        Args:
            path: Where in the document, or which variable or argument.
            value: What stands there, as it is shown.
            allowed: What may stand there.
            source: Which document it is.
        """
        return cls([Fault(path=path, value=value, allowed=allowed)], source=source)


T = TypeVar("T")


class KeptFaults:
    """The faults of several looks at one document, which are told at once; it is true if there are any."""

    def __init__(self) -> None:
        self._refusals: list[DocumentError] = []

    def __bool__(self) -> bool:
        return bool(self._refusals)

    def keep(self, look: Callable[[], T]) -> T | None:
        """Returns what was looked up; None where it is at fault, and the faults are kept."""
        try:
            return look()
        except DocumentError as exc:
            self._refusals.append(exc)
            return None

    def add(self, faults: Sequence[Fault]) -> None:
        """Keeps faults that somebody else has found."""
        if faults:
            self._refusals.append(DocumentError(faults))

    def together(self) -> DocumentError:
        """Returns all that was kept as one refusal, each fault once, of the kind that all of them are."""
        kinds = {type(each) for each in self._refusals}
        kind = kinds.pop() if len(kinds) == 1 else DocumentError
        return kind(list(dict.fromkeys(fault for each in self._refusals for fault in each.faults)))


class ConcurrentDeployment(DocumentError):  # noqa: N818 - RoboMaker's name
    """A fleet takes one deployment at a time (docs/reference/robomaker.md, section 8)."""


class IdempotentParameterMismatch(DocumentError):  # noqa: N818 - RoboMaker's name
    """A clientRequestToken comes again with another request (docs/reference/robomaker.md, section 2)."""


class LimitExceeded(DocumentError):  # noqa: N818 - RoboMaker's name
    """A document asks for one more than there may be, such as a 41st version of an application.

    See docs/reference/robomaker.md, section 9.
    """


class ResourceAlreadyExists(DocumentError):  # noqa: N818 - RoboMaker's name
    """A document asks for something to be made under a name that is taken."""


class ResourceNotFound(DocumentError):  # noqa: N818 - RoboMaker's name
    """A document refers to a template, world, application, fleet or job that does not exist."""


class AccessRefused(SimyardError):  # noqa: N818 - a state
    """A request over HTTP is not let in; nothing was done.

    Attributes:
        code: What AWS's services call it, such as ``AccessDeniedException``.
        status: HTTP's.
    """

    def __init__(self, code: str, reason: str, status: int = 403) -> None:
        self.code = code
        self.status = status
        super().__init__(reason)


class BundleRefused(SimyardError):  # noqa: N818 - a state
    """An archive is not what its digest says, or holds what no bundle may; nothing of it was unpacked."""


class LaunchRefused(SimyardError):  # noqa: N818 - a state
    """A ROS launch file cannot be run here: ROS is missing, or roslaunch or Simyard refuses the file."""


class StageFailed(SimyardError):  # noqa: N818 - a state, as RoboMaker names it
    """A stage reached its Failed state.

    Attributes:
        code: RoboMaker's failure code, such as ``AccessDenied``.
        reason: What happened, for a person.
        arn: The job that failed, or an empty string where none was made.
    """

    def __init__(self, code: str, reason: str, arn: str = "") -> None:
        self.code = code
        self.reason = reason
        self.arn = arn
        super().__init__(f"{code}: {reason}" + (f" ({arn})" if arn else ""))


class PipelineNotPassed(SimyardError):  # noqa: N818 - a verdict
    """A run came to its end, and what was asked for did not pass.

    Attributes:
        report: What each stage did; its ``undecided`` tells INCONCLUSIVE from what failed.
    """

    def __init__(self, report: PipelineReport) -> None:
        self.report = report
        refused = report.verdict not in (None, "PASS")
        answer = f"the gate says {report.verdict}" if refused else "the deployment failed"
        stage = "gate" if refused else "deployment"
        why = "".join(f": {each.summary}" for each in report.stages if each.name == stage)
        super().__init__(f"{report.name}: {answer}{why} ({report.run})")


class TrustRefused(SimyardError):  # noqa: N818 - a state
    """What the keys do not vouch for: changed, older than what was seen, expired, or signed by others."""


class TrustExpired(TrustRefused):
    """What the keys vouched for until a time that is over by this machine's clock; another look may find it good."""


class WorldChanged(SimyardError):  # noqa: N818 - a state
    """A world's document has another SHA-256 than it had."""


class StoreError(SimyardError):
    """The store could not do what was asked; names the key or URL, and the remedy where there is one."""


class StoreUnreachable(StoreError):  # noqa: N818 - a state
    """The store does not answer, or the place it names does not exist."""


class BucketNotFound(StoreUnreachable):
    """The server answers, and has no such bucket."""


class StoreAway(StoreUnreachable):
    """The store does not answer now, or says that it is in trouble itself; nobody has to change anything."""


class StoreThrottled(StoreAway):
    """The store asks to be asked less often, and went on doing so while it was asked less often."""


class StoreFull(StoreError):  # noqa: N818 - a state
    """There is no room for the object: a full disk, a quota, or more than an object may hold."""


class StoreDamaged(StoreError):  # noqa: N818 - a state
    """What arrived is not what was sent."""


class StoreUnsafe(StoreError):  # noqa: N818 - a state
    """The store ignores conditions on writes, so two writers could both believe they were first."""


class StoreAccessDenied(StoreError):  # noqa: N818 - a state
    """The store refuses the credentials, or the folder is read-only."""


class ObjectNotFound(StoreError):  # noqa: N818 - a state
    """There is no object under the key."""


class ObjectCorrupt(StoreError):  # noqa: N818 - a state
    """An object is not what this version of Simyard writes there."""


class ObjectTooBig(StoreError):  # noqa: N818 - a state
    """An object has more bytes than whoever reads it reckons with; they were not read."""


class ObjectExists(StoreError):  # noqa: N818 - a state
    """An atomic creation lost: the key is taken."""


class ObjectConflict(StoreError):  # noqa: N818 - a state
    """A compare-and-swap lost: the object is not what it was when it was read."""
