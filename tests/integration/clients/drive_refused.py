"""Each documented error that a store in order can give, against two gateways without a worker on one store.

    python drive_refused.py STATE_FILE [AWS_CLI]

The store is one that drive_work.py has worked on; STATE_FILE is what that wrote. ``LIMITED`` is the address of a
gateway whose quotas are all 1. It prints the errors that it got, by operation.
"""

import copy
import json
import os
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from caller import Caller, Refused
from drive_work import GENERAL, PAGES, ROLE, SUITES, TEMPLATE, job_request

_MOST_VERSIONS = 40
# Others that make or delete something do not document that it is not there.
_NAMES_OTHERS = {"CreateDeploymentJob", "CreateWorldExportJob", "CreateWorldGenerationJob", "DeleteWorldTemplate"}
Made = dict[str, Any]


class Expected:
    """Calls that must be refused.

    Args:
        call: Of a gateway.
        got: The errors by operation, to which those of the calls are added.
    """

    def __init__(self, call: Caller, got: dict[str, set[str]]) -> None:
        self._call, self._got = call, got

    def __call__(self, error: str, operation: str, **members: Any) -> None:  # noqa: ANN401 - RoboMaker's requests
        """Calls an operation, and asserts that it is refused with an error."""
        code, said = self._refusal(operation, members)
        assert code == f"{error}Exception", (operation, error, said)
        assert "/store/" not in said, said  # no message has a path of the server
        self._got[operation].add(error)

    def _refusal(self, operation: str, members: dict[str, Any]) -> tuple[str, str]:
        try:
            answer = self._call(operation, **members)
        except Refused as exc:
            return exc.code, str(exc)
        return "", str(answer)


def by_name(made: Made) -> dict[str, dict[str, str]]:
    """Returns what each operation about one thing that is there is asked."""
    one = {
        "Fleet": {"fleet": made["fleet"]},
        "Robot": {"robot": made["robot"]},
        "RobotApplication": {"application": made["Robot"]},
        "SimulationApplication": {"application": made["Simulation"]},
        "WorldTemplate": {"template": made["template"]},
        "World": {"world": made["worlds"][0]},
        "SimulationJob": {"job": made["job"]},
        "SimulationJobBatch": {"batch": made["batch"]},
        "WorldGenerationJob": {"job": made["generation"]},
        "WorldExportJob": {"job": made["export"]},
        "DeploymentJob": {"job": made["deployment"]},
    }
    words = {
        "Describe": one,
        "Delete": ("Fleet", "Robot", "RobotApplication", "SimulationApplication", "WorldTemplate"),
        "Cancel": ("SimulationJob", "SimulationJobBatch", "WorldGenerationJob", "WorldExportJob", "DeploymentJob"),
    }
    return {f"{word}{kind}": one[kind] for word, kinds in words.items() for kind in kinds} | {
        "RestartSimulationJob": one["SimulationJob"],
        "GetWorldTemplateBody": one["WorldTemplate"],
    }


def requests(made: Made) -> dict[str, dict[str, Any]]:
    """Returns a request that would be answered, for each operation that makes or changes something."""
    pair = {"fleet": made["fleet"], "robot": made["robot"]}
    robot = {"architecture": "X86_64", "greengrassGroupId": "none"}
    sync = {"clientRequestToken": "new-sync", "fleet": made["fleet"]}
    tagged = {"resourceArn": made["fleet"]}
    return {
        "CreateDeploymentJob": {**made["asked"], "clientRequestToken": "new"},
        "CreateFleet": {"name": "new"},
        "CreateRobot": {"name": "new", **robot},
        "CreateRobotApplication": {"name": "new", "robotSoftwareSuite": GENERAL},
        "CreateRobotApplicationVersion": {"application": made["Robot"]},
        "CreateSimulationApplication": {"name": "new", **SUITES},
        "CreateSimulationApplicationVersion": {"application": made["Simulation"]},
        "CreateSimulationJob": job_request(made),
        "CreateWorldExportJob": {
            "worlds": made["worlds"][:1],
            "outputLocation": {"s3Bucket": "worlds"},
            "iamRole": ROLE,
        },
        "CreateWorldGenerationJob": {"template": made["template"], "worldCount": {"floorplanCount": 1}},
        "CreateWorldTemplate": {"name": "new", "templateBody": json.dumps(TEMPLATE)},
        "DeregisterRobot": pair,
        "ListTagsForResource": tagged,
        "RegisterRobot": pair,
        "StartSimulationJobBatch": {"createSimulationJobRequests": [job_request(made)]},
        "SyncDeploymentJob": sync,
        "TagResource": {**tagged, "tags": {"a": "b"}},
        "UntagResource": {**tagged, "tagKeys": ["a"]},
        "UpdateRobotApplication": {"application": made["Robot"], "robotSoftwareSuite": GENERAL},
        "UpdateSimulationApplication": {"application": made["Simulation"], **SUITES},
        "UpdateWorldTemplate": {"template": made["template"], "name": "new"},
    }


def changed(request: dict[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """Returns a request whose first ARN, or list of ARNs, is another."""
    members = ("fleet", "robot", "application", "template", "world", "job", "batch", "resourceArn", "worlds")
    name = next(name for name in members if name in request)
    value = request[name]
    return {**request, name: [change(each) for each in value] if isinstance(value, list) else change(value)}


def absent(arn: str) -> str:
    """Returns the ARN of a thing of the same kind that is not there."""
    if ":world/" in arn:
        return f"{arn}-none"
    head, _, name = arn.rpartition("/")
    prefix = name.partition("-")[0]
    numbered = prefix in {"sim", "sjb", "wgj", "wej", "dep", "wt"}
    return f"{head}/{prefix}-{'0' * 16}{'0' if prefix == 'sim' else ''}" if numbered else f"{head}/none"


def not_found(refused: Expected, made: Made) -> None:
    """What is not there, of every operation that documents the error."""
    for name, request in {**by_name(made), **requests(made)}.items():
        if not name.startswith(("Create", "Delete", "Start")) or name in _NAMES_OTHERS:
            refused("ResourceNotFound", name, **changed(request, absent))
    gone = copy.deepcopy(requests(made)["CreateSimulationJob"])
    gone["simulationApplications"][0]["worldConfigs"] = [{"world": absent(made["worlds"][0])}]
    refused("ResourceNotFound", "CreateSimulationJob", **gone)
    refused("ResourceNotFound", "BatchDescribeSimulationJob", jobs=[made["fleet"]])
    nowhere = {"s3Bucket": "nowhere", "s3Key": "flat.json"}
    refused("ResourceNotFound", "CreateWorldTemplate", templateLocation=nowhere)


def invalid(refused: Expected, made: Made) -> None:
    """What breaks a rule, of every operation."""
    for name, request in by_name(made).items():
        wrong = made["robot"] if "robot" not in request else made["fleet"]
        refused("InvalidParameter", name, **changed(request, lambda _, wrong=wrong: wrong))
    bad_name = {"name": "no/such name!"}
    entry = {**job_request(made), "maxJobDurationInSeconds": 0}
    changes: dict[str, Any] = {
        **dict.fromkeys(("CreateFleet", "CreateRobot", "CreateRobotApplication"), bad_name),
        "CreateSimulationApplication": bad_name,
        "UpdateWorldTemplate": {"templateBody": "{"},
        "CreateWorldTemplate": {"templateBody": "{"},
        "CreateSimulationJob": entry,
        "StartSimulationJobBatch": {"createSimulationJobRequests": [entry]},
        "CreateWorldExportJob": {"worlds": [made["fleet"]]},
        "TagResource": {"tags": {"aws:x": "y"}},
        "UntagResource": {"resourceArn": "no-arn"},
        "ListTagsForResource": {"resourceArn": "no-arn"},
    }
    for name, request in requests(made).items():
        change = changes.get(name)
        # Where nothing else can be wrong, a thing of another kind is named.
        wrong = {**request, **change} if change else changed(request, lambda _: made["worlds"][0])
        refused("InvalidParameter", name, **wrong)
    for name in PAGES:
        refused("InvalidParameter", name, nextToken="made-up")
    refused("InvalidParameter", "BatchDescribeSimulationJob", jobs=["no ARN at all"])
    refused("InvalidParameter", "BatchDeleteWorlds", worlds=made["worlds"][:1] * 101)


def taken(refused: Expected, made: Made) -> None:
    """Names that are taken."""
    asked = requests(made)
    for name, there in {
        "CreateRobot": "nobody",
        "CreateRobotApplication": "courier-by-api",
        "CreateSimulationApplication": "delivery-by-api",
        "CreateWorldTemplate": "other",
    }.items():
        refused("ResourceAlreadyExists", name, **{**asked[name], "name": there})


def tokens(call: Caller, refused: Expected, made: Made) -> None:
    """Tokens that came before with another request; jobs are left that nobody works on."""
    asked = requests(made)
    for name in ("CreateSimulationJob", "StartSimulationJobBatch", "CreateWorldExportJob", "CreateWorldGenerationJob"):
        token = {"clientRequestToken": f"again-{name}"}
        first = call(name, **asked[name], **token)
        assert call(name, **asked[name], **token)["arn"] == first["arn"]
        refused("IdempotentParameterMismatch", name, **asked[name], **token, tags={"another": "request"})
    for name in ("CreateDeploymentJob", "SyncDeploymentJob"):
        used = {"clientRequestToken": made["asked"]["clientRequestToken"], "fleet": made["silent"]}
        refused("IdempotentParameterMismatch", name, **{**asked[name], **used})


def cancels(call: Caller, made: Made) -> None:
    """Jobs of worlds that are canceled before anybody began them."""
    for kind in ("WorldExportJob", "WorldGenerationJob"):
        job = call(f"Create{kind}", **requests(made)[f"Create{kind}"])["arn"]
        call(f"Cancel{kind}", job=job)
        assert call(f"Describe{kind}", job=job)["status"] == "Canceled"


def concurrent(call: Caller, refused: Expected, made: Made) -> None:
    """A deployment that waits, and whose fleet takes no other."""
    asked = requests(made)
    call("CreateDeploymentJob", **asked["CreateDeploymentJob"])
    refused("ConcurrentDeployment", "CreateDeploymentJob", **{**made["asked"], "clientRequestToken": "newer"})
    refused("ConcurrentDeployment", "SyncDeploymentJob", **asked["SyncDeploymentJob"])


def too_many(call: Caller, refused: Expected, made: Made) -> None:
    """One more than the quotas allow; a job of each kind waits by now, and a second one of CreateSimulationJob."""
    asked = requests(made)
    call("CreateSimulationJob", **asked["CreateSimulationJob"])
    other = {"clientRequestToken": "another", "fleet": made["silent"]}
    for name in (
        "CreateFleet",
        "CreateRobot",
        "CreateRobotApplication",
        "CreateSimulationApplication",
        "CreateSimulationJob",
        "CreateWorldGenerationJob",
        "CreateWorldTemplate",
        "StartSimulationJobBatch",
    ):
        refused("LimitExceeded", name, **asked[name])
    refused("LimitExceeded", "RegisterRobot", fleet=made["fleet"], robot=made["nobody"])
    refused("LimitExceeded", "RestartSimulationJob", job=made["job"])
    refused("LimitExceeded", "CreateDeploymentJob", **{**asked["CreateDeploymentJob"], **other})
    refused("LimitExceeded", "SyncDeploymentJob", **other)


def versions(call: Caller, refused: Expected, made: Made) -> None:
    """A version more than an application may have: each is of another image."""
    for kind, suites in (("Robot", {"robotSoftwareSuite": GENERAL}), ("Simulation", SUITES)):
        name, application = f"Create{kind}ApplicationVersion", made[f"{kind}-2"]
        image = {"environment": {"uri": "111122223333.dkr.ecr.us-west-2.amazonaws.com/courier:latest"}}
        call(f"Update{kind}Application", application=application, **suites, **image)
        digest = "sha256:{:064x}".format
        for number in range(_MOST_VERSIONS):
            call(name, application=application, imageDigest=digest(number))
        refused("LimitExceeded", name, application=application, imageDigest=digest(_MOST_VERSIONS))


def main() -> None:
    """Makes all calls."""
    made: Made = json.loads(Path(sys.argv[1]).read_text())
    got: dict[str, set[str]] = defaultdict(set)
    call = Caller(os.environ["AWS_ENDPOINT_URL_ROBOMAKER"], *sys.argv[2:])
    limited = Expected(Caller(os.environ["LIMITED"], *sys.argv[2:]), got)
    refused = Expected(call, got)
    not_found(refused, made)
    invalid(refused, made)
    taken(refused, made)
    tokens(call, refused, made)
    cancels(call, made)
    concurrent(call, refused, made)
    too_many(call, limited, made)
    versions(call, refused, made)
    sys.stdout.write(json.dumps({name: sorted(errors) for name, errors in got.items()}))


if __name__ == "__main__":
    main()
