"""All 57 operations as a user makes them, and each paginator, against a gateway with a worker and a robot's agent.

    python drive_work.py [AWS_CLI]

The environment leads to the gateway. It prints what was called and how long the pages were.
"""

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from caller import Caller, Refused

_TRIES = 3
ROLE = "arn:aws:iam::111122223333:role/robomaker"
GENERAL = {"name": "General"}
SUITES = {"robotSoftwareSuite": GENERAL, "simulationSoftwareSuite": {"name": "SimulationRuntime"}}
TEMPLATE = {
    "Version": "1",
    "Buildings": [{"Floors": [{"Floorplan": {"Rooms": [{"Type": "Living", "Name": "Living room"}]}}]}],
}
PAGES = {
    "ListDeploymentJobs": "deploymentJobs",
    "ListFleets": "fleetDetails",
    "ListRobotApplications": "robotApplicationSummaries",
    "ListRobots": "robots",
    "ListSimulationApplications": "simulationApplicationSummaries",
    "ListSimulationJobBatches": "simulationJobBatchSummaries",
    "ListSimulationJobs": "simulationJobSummaries",
    "ListWorldExportJobs": "worldExportJobSummaries",
    "ListWorldGenerationJobs": "worldGenerationJobSummaries",
    "ListWorldTemplates": "templateSummaries",
    "ListWorlds": "worldSummaries",
}


def worlds(call: Caller) -> dict[str, Any]:
    """Returns a template and two worlds of it; each call about templates, worlds, exports and tags is made."""
    template = call("CreateWorldTemplate", name="flat", templateBody=json.dumps(TEMPLATE))["arn"]
    call("CreateWorldTemplate", name="other", templateBody=json.dumps(TEMPLATE))
    call("UpdateWorldTemplate", template=template, name="one room")
    assert call("DescribeWorldTemplate", template=template)["name"] == "one room"
    assert json.loads(call("GetWorldTemplateBody", template=template)["templateBody"])["Buildings"]
    counts = {"floorplanCount": 3, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", template=template, worldCount=counts)["arn"]
    done = call.ended("DescribeWorldGenerationJob", job=job)
    assert done["status"] == "Completed", done
    made = done["finishedWorldsSummary"]["succeededWorlds"]
    assert call("DescribeWorld", world=made[0])["template"] == template
    place = {"worlds": made[:1], "outputLocation": {"s3Bucket": "worlds"}, "iamRole": ROLE}
    export = call("CreateWorldExportJob", **place)["arn"]
    assert call.ended("DescribeWorldExportJob", job=export)["status"] == "Completed"
    _cancels(call, "WorldExportJob", **place)
    _cancels(call, "WorldGenerationJob", template=template, worldCount=counts)
    call("TagResource", resourceArn=template, tags={"a/b=c:d": "e f", "team": "arms"})
    call("UntagResource", resourceArn=template, tagKeys=["a/b=c:d"])
    assert call("ListTagsForResource", resourceArn=template)["tags"] == {"team": "arms"}
    return {"template": template, "worlds": made, "generation": job, "export": export}


def _cancels(call: Caller, kind: str, **request: Any) -> None:  # noqa: ANN401 - RoboMaker's requests
    """Cancels a job at once; a worker may have been quicker, which the call then says."""
    for _ in range(_TRIES):
        job = call(f"Create{kind}", **request)["arn"]
        try:
            call(f"Cancel{kind}", job=job)
        except Refused:
            continue
        assert call.ended(f"Describe{kind}", job=job)["status"] == "Canceled"
        return


def applications(call: Caller) -> dict[str, Any]:
    """Returns the ARN of an application of each kind, with version 1."""
    found: dict[str, Any] = {}
    for kind, name, suites in (
        ("Robot", "courier-by-api", {"robotSoftwareSuite": GENERAL}),
        ("Simulation", "delivery-by-api", SUITES),
    ):
        sources = [{"s3Bucket": "builds", "s3Key": f"{name}.tar", "architecture": "X86_64"}]
        made = call(f"Create{kind}Application", name=name, sources=sources, **suites)
        asked = {"application": made["arn"], "sources": sources, "currentRevisionId": made["revisionId"], **suites}
        revision = call(f"Update{kind}Application", **asked)["revisionId"]
        version = call(f"Create{kind}ApplicationVersion", application=made["arn"], currentRevisionId=revision)
        assert version["version"] == "1"
        assert call(f"Describe{kind}Application", application=made["arn"], applicationVersion="1")["name"] == name
        other = call(f"Create{kind}Application", name=f"{name}-2", sources=sources, **suites)["arn"]
        third = call(f"Create{kind}Application", name=f"{name}-3", sources=sources, **suites)["arn"]
        call(f"Delete{kind}Application", application=third)
        found |= {kind: made["arn"], f"{kind}-2": other}
    return found


def job_request(made: dict[str, Any], *, goals: int = 1, limit_s: int = 120) -> dict[str, Any]:
    """Returns what CreateSimulationJob is asked, or an entry of a batch."""
    launch = {"packageName": "delivery", "launchFile": "rooms", "environmentVariables": {"GOALS": str(goals)}}
    robot = {"packageName": "courier", "launchFile": "go_to_goal", "environmentVariables": {}}
    scenario = {"application": made["Simulation"], "launchConfig": launch}
    return {
        "maxJobDurationInSeconds": limit_s,
        "iamRole": ROLE,
        "outputLocation": {"s3Bucket": "results"},
        "robotApplications": [{"application": made["Robot"], "launchConfig": robot}],
        "simulationApplications": [{**scenario, "worldConfigs": [{"world": made["worlds"][0]}]}],
        "vpcConfig": {"subnets": ["subnet-1"], "securityGroups": ["sg-1"], "assignPublicIp": True},
    }


def simulations(call: Caller, made: dict[str, Any]) -> dict[str, Any]:
    """Returns a job and a batch that have ended; each call about simulation is made."""
    long = call("CreateSimulationJob", **job_request(made, goals=100, limit_s=100_000))["arn"]
    call.until("DescribeSimulationJob", {"Running"}, job=long)
    call("RestartSimulationJob", job=long)
    call("CancelSimulationJob", job=long)
    assert call.ended("DescribeSimulationJob", job=long)["status"] == "Canceled"
    started = call("StartSimulationJobBatch", createSimulationJobRequests=[job_request(made)] * 2)["arn"]
    second = call("StartSimulationJobBatch", createSimulationJobRequests=[job_request(made)])["arn"]
    call("CancelSimulationJobBatch", batch=second)
    done = call.ended("DescribeSimulationJobBatch", batch=started)
    assert (done["status"], len(done["failedRequests"])) == ("Completed", 0), done
    arns = [each["arn"] for each in done["createdRequests"]]
    told = call("BatchDescribeSimulationJob", jobs=[*arns, long])["jobs"]
    outcomes = [each["tags"].get("simyard:outcome") for each in told]
    assert outcomes[:2] in (["Passed", "Passed"], ["Failed", "Failed"]), told
    assert call.ended("DescribeSimulationJobBatch", batch=second)["status"] == "Canceled"
    return {"job": arns[0], "batch": started}


def fleets(call: Caller, made: dict[str, Any], robot: str) -> dict[str, Any]:
    """Returns a fleet that was deployed to; each call about fleets is made, some of another without an agent."""
    fleet = call("CreateFleet", name="couriers", tags={"site": "north"})["arn"]
    one = call("CreateRobot", name=robot, architecture="X86_64", greengrassGroupId="none")["arn"]
    call("RegisterRobot", fleet=fleet, robot=one)
    launch = {"packageName": "courier", "launchFile": "run.sh"}
    configs = [{"application": made["Robot"], "applicationVersion": "1", "launchConfig": launch}]
    asked = {"clientRequestToken": "first", "fleet": fleet, "deploymentApplicationConfigs": configs}
    job = call("CreateDeploymentJob", **asked)["arn"]
    assert call.ended("DescribeDeploymentJob", job=job)["status"] == "Succeeded"
    sync = call("SyncDeploymentJob", clientRequestToken="once-more", fleet=fleet)["arn"]
    assert call.ended("DescribeDeploymentJob", job=sync)["status"] == "Succeeded"
    assert call("DescribeFleet", fleet=fleet)["robots"][0]["status"] == "InSync"
    assert call("DescribeRobot", robot=one)["fleetArn"] == fleet

    silent = call("CreateFleet", name="silent")["arn"]
    two = call("CreateRobot", name="nobody", architecture="X86_64", greengrassGroupId="none")["arn"]
    call("RegisterRobot", fleet=silent, robot=two)
    waits = call("CreateDeploymentJob", **{**asked, "clientRequestToken": "second", "fleet": silent})["arn"]
    call("CancelDeploymentJob", job=waits)
    return {"fleet": fleet, "robot": one, "deployment": job, "silent": silent, "nobody": two, "asked": asked}


def _refusal(call: Caller, operation: str, **members: Any) -> str:  # noqa: ANN401 - RoboMaker's requests
    try:
        call(operation, **members)
    except Refused as exc:
        return exc.code
    return ""


def deletions(call: Caller, made: dict[str, Any]) -> None:
    """Makes the calls that take something away, of things that nothing else needs."""
    other = call("CreateRobot", name="spare", architecture="ARM64", greengrassGroupId="none")["arn"]
    third = call("CreateFleet", name="third")["arn"]
    call("RegisterRobot", fleet=third, robot=other)
    call("DeregisterRobot", fleet=third, robot=other)
    call("DeleteRobot", robot=other)
    call("DeleteFleet", fleet=third)
    assert _refusal(call, "DescribeFleet", fleet=third) == "ResourceNotFoundException"
    spare = call("CreateWorldTemplate", name="spare", templateBody=json.dumps(TEMPLATE))["arn"]
    call("DeleteWorldTemplate", template=spare)
    assert not call("BatchDeleteWorlds", worlds=made["worlds"][2:]).get("unprocessedWorlds")


def main() -> None:
    """Makes all calls."""
    call = Caller(os.environ["AWS_ENDPOINT_URL_ROBOMAKER"], *sys.argv[1:])
    began_s = time.monotonic()
    made = worlds(call)
    made |= applications(call)
    made |= fleets(call, made, os.environ.get("ROBOT", "courier-1"))
    made |= simulations(call, made)
    pages = {name: call.pages(name, member) for name, member in PAGES.items()}
    deletions(call, made)
    said = {"called": sorted(call.called), "pages": pages, "s": round(time.monotonic() - began_s)}
    sys.stdout.write(json.dumps(said))


if __name__ == "__main__":
    main()
