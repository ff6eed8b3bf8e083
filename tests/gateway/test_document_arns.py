"""ARNs are changed where a document's types have them, and nowhere else."""

from pydantic import JsonValue

from specs.robomaker.deployment import DescribeFleetResponse
from specs.robomaker.simulation import BatchDescribeSimulationJobRequest, StartSimulationJobBatchRequest
from tasks.gateway.rest_json import with_arns


def changed(text: str) -> str:
    return f"new {text}"


def test_arns_of_fields_lists_and_parts_are_changed():
    fleet = {"arn": "arn:1", "robots": [{"arn": "arn:2", "lastDeploymentJob": "arn:3"}, {"name": "arn:4"}]}

    assert with_arns(fleet, DescribeFleetResponse, changed) == {
        "arn": "new arn:1",
        "robots": [{"arn": "new arn:2", "lastDeploymentJob": "new arn:3"}, {"name": "arn:4"}],
    }
    jobs = with_arns({"jobs": ["arn:1", "arn:2"]}, BatchDescribeSimulationJobRequest, changed)
    assert jobs == {"jobs": ["new arn:1", "new arn:2"]}


def test_texts_that_look_like_an_arn_stay():
    config: dict[str, JsonValue] = {
        "application": "arn:1",
        "launchConfig": {"environmentVariables": {"A": "arn:2"}},
        "worldConfigs": [{"world": "arn:3"}],
    }
    entry: dict[str, JsonValue] = {
        "iamRole": "arn:aws:iam::1:role/x",
        "simulationApplications": [config],
    }
    request = {"createSimulationJobRequests": [entry], "tags": {"arn:4": "arn:5"}}

    found = with_arns(request, StartSimulationJobBatchRequest, lambda text: text[-1])

    use = {**config, "application": "1", "worldConfigs": [{"world": "3"}]}
    assert found == {
        "createSimulationJobRequests": [{**entry, "simulationApplications": [use]}],
        "tags": {"arn:4": "arn:5"},
    }


def test_data_of_the_wrong_shape_stays_for_the_check_that_follows():
    for wrong in ({"robots": "arn:1"}, {"robots": [3, None, ["arn:2"]]}, {"arn": {"arn": 1}}, {"arn": 4}, {"x": "arn"}):
        assert with_arns(wrong, DescribeFleetResponse, str) == wrong
