"""Physical parameters as inputs: what MuJoCo makes of mass, friction and strength on each engine, and late commands."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

import specs.data.physics as parameters
import tasks.simulate.engines.planar.planar_robot as module
from specs.data.episode import EpisodeRequest
from specs.field_types import EngineName
from tasks.applications.registry import unpack
from tasks.simulate.application.robot_model import compile_robot
from tasks.simulate.audit.audit_drive import drive_sample
from tasks.simulate.audit.audit_report import DrivenEpisode
from tasks.simulate.engines.mujoco.world_stepper import varied_model
from tasks.simulate.engines.planar.planar_robot import PlanarRobot, planar_robot, varied_robot
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.store_url import open_store
from tests.factories.batches import PENS, PUSHER, pushing_plan
from tests.factories.planar import CAPSULE, LOAD, MOTORS, ROUGH, Parts, write_robot

FACTORS = (1.7, 0.6, 0.8)
ARM = '<geom name="arm" size="0.05" pos="0.16 -0.08 0" mass="0.1" condim="3" friction="0.3"/>'
ROBOTS: dict[str, Parts] = {
    "smooth": {},
    "rough": ROUGH,
    "two discs off the axis": {**CAPSULE, "hull/friction": "0.7", "hull/condim": "3", "more": ARM},
    "loaded, with armature": {**ROUGH, "more": LOAD, "x/armature": "0.4", "yaw/armature": "0.02"},
    "other motors": {"actuator": MOTORS, "x/frictionloss": "0.5"},
}
Numbers = dict[str, float]


def numbers(value: object, where: str = "") -> Numbers:
    """Returns all numbers of a robot, by where they stand."""
    if isinstance(value, tuple):
        parts = [numbers(each, f"{where}[{at}]") for at, each in enumerate(value)]
    elif is_dataclass(value):
        parts = [numbers(getattr(value, each.name), f"{where}.{each.name}") for each in fields(value)]
    else:
        return {where: float(value)} if isinstance(value, int | float | np.number) else {}
    return {name: number for part in parts for name, number in part.items()}


@pytest.mark.parametrize("name", ROBOTS)
def test_the_planar_engine_has_the_numbers_that_mujoco_derives(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = write_robot(tmp_path, ROBOTS[name])
    plain = planar_robot(path)
    ours = numbers(varied_robot(plain, np.array(FACTORS)))
    monkeypatch.setattr(module, "compile_robot", lambda spec: varied_model(compile_robot(spec), FACTORS))
    theirs = numbers(planar_robot(path))
    assert ours.keys() == theirs.keys()
    # A hull's mass is multiplied where a contact with a person is judged, by each episode's own factor.
    compared = ours.keys() - {".hull[3]"}
    assert [key for key in compared if not np.isclose(ours[key], theirs[key], rtol=1e-9, atol=0.0)] == []
    assert sum(ours[key] != value for key, value in numbers(plain).items()) >= 6


@pytest.mark.parametrize("name", ROBOTS)
def test_what_mujoco_derives_from_masses_is_what_it_would_set_itself(name: str, tmp_path: Path):
    model = mujoco.MjModel.from_xml_path(str(write_robot(tmp_path, ROBOTS[name])))
    ours, theirs = varied_model(model, FACTORS), varied_model(model, FACTORS)
    mujoco.mj_setConst(theirs, mujoco.MjData(theirs))
    for each in ("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0"):
        np.testing.assert_allclose(getattr(ours, each), getattr(theirs, each), rtol=1e-9)
    assert varied_model(model, (1.0, 1.0, 1.0)) is model


def test_where_all_factors_are_1_no_number_changes(tmp_path: Path):
    plain: PlanarRobot = planar_robot(write_robot(tmp_path, ROBOTS["loaded, with armature"]))
    assert numbers(varied_robot(plain, np.ones(3))) == numbers(plain)


def rough_bundle(folder: Path) -> Path:
    """Returns the pushing robot's bundle, made to rub along what it pushes."""
    bundle = folder / "rough"
    if not bundle.exists():
        shutil.copytree(PUSHER, bundle)
        file = bundle / "robot.xml"
        file.write_text(file.read_text().replace('condim="1"', 'condim="3" friction="0.6"'))
    return bundle


def driven(
    engine: EngineName,
    folder: Path,
    factors: Mapping[str, str],
    bundle: Path = PUSHER,
    delays_s: Sequence[str] = (),
) -> Sequence[DrivenEpisode]:
    """Returns episodes of the pushing robot on an engine, with variables of theirs, and delays in turns."""
    store = open_store((folder / "store").as_uri())
    plan = pushing_plan(store, robot=bundle)
    requests = [_with(each, factors) for each in Layout(plan).requests(0, 8)]
    if delays_s:
        names = [{parameters.CONTROL_DELAY: delays_s[number % len(delays_s)]} for number in range(len(requests))]
        requests = [_with(each, own) for each, own in zip(requests, names, strict=True)]
    bundles = {digest: unpack(store, digest, folder / "bundles") for digest in plan.digests()}
    found = drive_sample(requests, PENS, bundles, lanes=8, engine=engine)
    return [found[index] for index in sorted(found)]


def _with(request: EpisodeRequest, factors: Mapping[str, str]) -> EpisodeRequest:
    return request.model_copy(update={"environment": {**request.environment, **factors}})


DELAYS_S = ("0.15", "0", "1")
STEPS_BLIND = 20


@pytest.mark.parametrize("engine", ["planar", "mjx", "mujoco"])
def test_a_command_arrives_so_many_control_steps_later(engine: EngineName, tmp_path: Path):
    """A robot that does not look goes its way later; lanes with other delays are in the same program."""
    plain, late = driven(engine, tmp_path, {}), driven(engine, tmp_path, {}, delays_s=DELAYS_S)
    for number, (ours, theirs) in enumerate(zip(late, plain, strict=True)):
        steps = round(20 * float(DELAYS_S[number % len(DELAYS_S)]))
        begin, after = ours.places_m[:steps], ours.places_m[steps:][:STEPS_BLIND]
        assert not begin.any()  # where it starts
        np.testing.assert_array_equal(after, theirs.places_m[:STEPS_BLIND])
        assert steps or (ours.row, ours.places_m.tobytes()) == (theirs.row, theirs.places_m.tobytes())
        assert np.abs(np.diff(after, axis=0)).min(axis=0).max() > 1e-3


def apart_m(ours: Sequence[DrivenEpisode], theirs: Sequence[DrivenEpisode]) -> float:
    """Returns the median of how far apart two drives of an episode ever are."""
    pairs = [(one.places_m, other.places_m) for one, other in zip(ours, theirs, strict=True)]
    most = [np.abs(one[: len(other)] - other[: len(one)]).max() for one, other in pairs]
    return float(np.median(most))


@pytest.mark.long
@pytest.mark.parametrize("engine", ["planar", "mjx", "mujoco"])
def test_a_factor_of_1_changes_no_bit_of_an_episode(engine: EngineName, tmp_path: Path):
    plain, varied = driven(engine, tmp_path, {}), driven(engine, tmp_path, dict.fromkeys(parameters.FACTORS, "1"))
    assert [each.row for each in varied] == [each.row for each in plain]
    assert [each.places_m.tobytes() for each in varied] == [each.places_m.tobytes() for each in plain]


@pytest.mark.long
@pytest.mark.parametrize("engine", ["planar", "mjx"])
@pytest.mark.parametrize("factors", [{"robot.mass": "2"}, {"robot.motorStrength": "0.5", "robot.friction": "0.5"}])
def test_engines_agree_with_c_mujoco_about_a_factor(engine: EngineName, factors: Mapping[str, str], tmp_path: Path):
    reference, plain = driven("mujoco", tmp_path, factors), driven("mujoco", tmp_path, {})
    assert apart_m(reference, plain) > 0.01
    assert apart_m(driven(engine, tmp_path, factors), reference) < 1e-4


@pytest.mark.long
@pytest.mark.parametrize("engine", ["planar", "mjx"])
def test_engines_agree_with_c_mujoco_about_friction(engine: EngineName, tmp_path: Path):
    bundle, factors = rough_bundle(tmp_path), {"robot.friction": "10"}
    reference, plain = driven("mujoco", tmp_path, factors, bundle), driven("mujoco", tmp_path, {}, bundle)
    assert apart_m(reference, plain) > 1e-3
    assert apart_m(driven(engine, tmp_path, factors, bundle), reference) < 1e-4
