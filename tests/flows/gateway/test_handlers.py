from flows.gateway.handlers import HANDLERS
from specs.robomaker.operations import OPERATIONS


def test_every_operation_has_its_handler():
    assert HANDLERS.keys() == OPERATIONS.keys()
