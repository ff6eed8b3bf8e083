VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTHON ?= python3
TEST_PROCESSES ?= 3
PYTEST := $(BIN)/pytest --numprocesses $(TEST_PROCESSES) --dist loadgroup
# Whole documents, real servers, attacks and races, which make test-all runs as well.
WHOLE := tests/integration tests/attacks tests/deploy/promises

.DEFAULT_GOAL := help
.PHONY: help run ros ros2 test test-all explore check format lint types layers bench soak lock

help:
	@echo "make run    set up, then carry examples/quickstart.yaml from template to fleet"
	@echo "make ros    set up, then carry a public ROS package from its launch file to a robot"
	@echo "make ros2   set up, then carry a package of rclpy from its launch file to a robot"
	@echo "make test   set up, then run the tests that a person waits for"
	@echo "make test-all  run the long ones as well: kills, faults, whole documents, browsers"
	@echo "make explore  run the tests with new random examples, many more of them"
	@echo "make soak   the longest tests: clusters, faults, engines, and the promises of fleets; write the figures into docs/operate/fleet.md"
	@echo "make check  format, lint, types, import layers, tests"
	@echo "make bench  print the benchmark tables"
	@echo "make lock   pin every version in constraints.txt"

# Compiled bytecode makes imports three times faster: it is written also where the environment says that it is not.
export PYTHONDONTWRITEBYTECODE :=
$(READY): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt uv
	$(BIN)/uv pip install --quiet --python $(BIN)/python --compile-bytecode --constraint constraints.txt --editable '.[dev]'
	$(BIN)/python -m compileall -q simyard flows tasks specs
	touch $(READY)

run: $(READY)
	$(BIN)/simyard run examples/quickstart.yaml

# Installs Debian's ROS as root alone; else it prints the command.
ros: $(READY)
	examples/ros/make_ros.sh

# ROS 2's rclpy comes from PyPI, into a folder of its own.
ros2: $(READY)
	examples/ros/make_ros2.sh

# Tests wait for servers and for programs that they start: three processes keep two cores busy. `tests/file_scheduler.py`
# says which tests stay together in one.
test: $(READY)
	$(PYTEST) -m 'not long' $(addprefix --ignore=,$(WHOLE))

test-all: $(READY)
	$(PYTEST)

# Not part of the tests: it may find what nobody knew, in code that nobody touched.
explore: $(READY)
	SIMYARD_HYPOTHESIS=explore $(BIN)/pytest --ignore tests/integration

check: format lint types layers test

format: $(READY)
	$(BIN)/ruff format --check .

lint: $(READY)
	$(BIN)/ruff check .

types: $(READY)
	$(BIN)/pyright

layers: $(READY)
	$(BIN)/lint-imports

bench: $(READY)
	$(BIN)/python benchmarks/door.py
	$(BIN)/python benchmarks/quickstart.py
	$(BIN)/python benchmarks/worlds/world_tables.py

# An hour or so; what the tests try in short. The figures are of a run that kept every promise, or they are not written.
soak: $(READY)
	rm -f soak.jsonl
	$(BIN)/pytest -m soak --ignore tests/deploy/promises
	SIMYARD_SOAK_REPORT=$(CURDIR)/soak.jsonl $(BIN)/pytest -m soak tests/deploy/promises
	$(BIN)/python -m benchmarks.fleet.promises soak.jsonl --document docs/operate/fleet.md

lock: $(READY)
	$(BIN)/uv pip compile --quiet --upgrade --no-header --no-annotate --extra dev --output-file constraints.txt pyproject.toml
