"""From a world template to a fleet of robots by RoboMaker's API alone: boto3, and no import of Simyard.

It is what a CI script for RoboMaker did. docs/guide/from-robomaker.md says which variables it needs; the bundles of the
two applications lie in the bucket `builds`, and an agent runs on the robot.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import boto3

BUCKET = "builds"
ROLE = "arn:aws:iam::111122223333:role/robomaker"
ENDED = {"Completed", "PartialFailed", "Failed", "Succeeded", "TimedOut", "Canceled", "Terminated"}
TEMPLATE = """{
    "Version": "1",
    "Buildings": [{"Floors": [{"Floorplan": {
        "Ceiling": {"Height": 3.0},
        "Rooms": [
            {"Type": "Living", "Name": "Living room", "DesiredShape": {"Area": 24, "AspectRatio": {"x": 1, "y": 1.5}}},
            {"Type": "Bedroom", "Name": "Bedroom", "DesiredShape": {"Area": 14, "AspectRatio": {"x": 1, "y": 1}}}
        ],
        "DesiredConnections": [{"Location": ["Living room", "Bedroom"], "ConnectionType": "Doorway"}]
    }}]}]
}"""

robomaker = boto3.client("robomaker")


def wait(describe: Callable[..., dict[str, Any]], **job: str) -> dict[str, Any]:
    """Returns what a Describe call answers once its job has ended."""
    while (answer := describe(**job))["status"] not in ENDED:
        time.sleep(0.5)
    print(f"{answer['arn']}: {answer['status']}", flush=True)
    if answer["status"] not in {"Completed", "Succeeded"}:
        sys.exit(f"{answer['arn']}: {answer.get('failureCode')}: {answer.get('failureReason')}")
    return answer


def application(kind: str, name: str, **suites: dict[str, str]) -> tuple[str, str]:
    """Returns the ARN of an application that is made from its bundle, and the number of its version."""
    create = getattr(robomaker, f"create_{kind}_application")
    made = create(name=name, sources=[{"s3Bucket": BUCKET, "s3Key": f"{name}.tar", "architecture": "X86_64"}], **suites)
    version = getattr(robomaker, f"create_{kind}_application_version")(application=made["arn"])
    return made["arn"], version["version"]


def apartments() -> list[str]:
    """Returns the ARNs of four apartments, exported to a bucket as well."""
    template = robomaker.create_world_template(name="two-rooms", templateBody=TEMPLATE)
    counts = {"floorplanCount": 2, "interiorCountPerFloorplan": 2}
    job = robomaker.create_world_generation_job(template=template["arn"], worldCount=counts)
    made = wait(robomaker.describe_world_generation_job, job=job["arn"])
    worlds: list[str] = made["finishedWorldsSummary"]["succeededWorlds"]
    export = robomaker.create_world_export_job(worlds=worlds, outputLocation={"s3Bucket": "worlds"}, iamRole=ROLE)
    wait(robomaker.describe_world_export_job, job=export["arn"])
    return worlds


def batch(robot: str, scenario: str, worlds: list[str]) -> None:
    """Drives the robot once through each world, and ends the script if a test failed."""
    robots = [{"application": robot, "launchConfig": {"packageName": "courier", "launchFile": "go_to_goal"}}]
    launch = {"packageName": "delivery", "launchFile": "rooms"}
    requests = [
        {
            "maxJobDurationInSeconds": 300,
            "iamRole": ROLE,
            "outputLocation": {"s3Bucket": "results"},
            "robotApplications": robots,
            "simulationApplications": [
                {"application": scenario, "launchConfig": launch, "worldConfigs": [{"world": world}]}
            ],
        }
        for world in worlds
    ]
    policy = {"timeoutInSeconds": 800, "maxConcurrency": 8}
    started = robomaker.start_simulation_job_batch(batchPolicy=policy, createSimulationJobRequests=requests)
    ended = wait(robomaker.describe_simulation_job_batch, batch=started["arn"])
    arns = [each["arn"] for each in ended["createdRequests"]]
    for job in robomaker.batch_describe_simulation_job(jobs=arns)["jobs"]:
        print(f"{job['arn']}: {job['status']} {job['tags']}")
        if "Failed" in job["tags"].values():
            print("a test failed; a CI script would end here")


def fleet(robot: str, application: str, version: str) -> None:
    """Brings the tested version to a fleet of one robot, and brings the fleet up to date once more."""
    couriers = robomaker.create_fleet(name="couriers-by-api")["arn"]
    made = robomaker.create_robot(name=robot, architecture="X86_64", greengrassGroupId="none")
    robomaker.register_robot(fleet=couriers, robot=made["arn"])
    launch = {"packageName": "courier", "launchFile": "run.sh"}
    deployment = robomaker.create_deployment_job(
        clientRequestToken="first-roll-out",
        fleet=couriers,
        deploymentConfig={"concurrentDeploymentPercentage": 100, "failureThresholdPercentage": 100},
        deploymentApplicationConfigs=[
            {"application": application, "applicationVersion": version, "launchConfig": launch}
        ],
    )
    wait(robomaker.describe_deployment_job, job=deployment["arn"])
    sync = robomaker.sync_deployment_job(clientRequestToken="once-more", fleet=couriers)
    wait(robomaker.describe_deployment_job, job=sync["arn"])
    for each in robomaker.describe_fleet(fleet=couriers)["robots"]:
        print(f"{each['arn']}: {each['status']}")


if __name__ == "__main__":
    courier, number = application("robot", "courier-by-api", robotSoftwareSuite={"name": "General"})
    delivery, _ = application(
        "simulation",
        "delivery-by-api",
        robotSoftwareSuite={"name": "General"},
        simulationSoftwareSuite={"name": "SimulationRuntime"},
    )
    batch(courier, delivery, apartments())
    fleet(sys.argv[1] if len(sys.argv) > 1 else "courier-1", courier, number)
