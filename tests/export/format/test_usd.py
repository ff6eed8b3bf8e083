"""Pixar's checker takes the stage, and finds in it what the world says, where the world says."""

import math
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade, UsdUtils

from specs.data.world import Door, World, solids
from tasks.export.format.usd import USD_FILE, usd_files
from tasks.render.sheets import sheets
from tasks.render.textures import texture_of
from tests.export.variants import DOOR, HINGE_M, other_hand, with_door, with_windows
from tests.factories.worlds import apartment

WORLD = with_windows(with_door(30.0))


def written(world: World, folder: Path) -> Path:
    for path, body in usd_files(world).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(body)
    return folder / USD_FILE


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(written(WORLD, tmp_path)))


def numbers(vector: Gf.Vec3d) -> list[float]:
    return [*cast("tuple[float, float, float]", vector)]


def shown_name(prim: Usd.Prim) -> str:
    return prim.GetDisplayName() or prim.GetName()


def by_name(stage: Usd.Stage) -> dict[str, Usd.Prim]:
    return {shown_name(prim): prim for prim in stage.Traverse()}


def checked(file: Path) -> tuple[list[str], list[str], list[str]]:
    checker = UsdUtils.ComplianceChecker()
    checker.CheckCompliance(str(file))
    return checker.GetErrors(), checker.GetFailedChecks(), checker.GetWarnings()


def test_the_compliance_checker_finds_nothing(tmp_path: Path):
    assert checked(written(WORLD, tmp_path)) == ([], [], [])


def test_the_compliance_checker_would_find_something(tmp_path: Path):
    file = written(WORLD, tmp_path)
    file.write_text(file.read_text().replace('upAxis = "Z"', "").replace('defaultPrim = "World"', ""))
    assert checked(file)[1] != []


def test_metres_and_z_up(stage: Usd.Stage):
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"


def test_every_solid_is_where_the_world_says_and_collides(stage: Usd.Stage):
    prims, places = by_name(stage), UsdGeom.XformCache()
    for solid in solids(WORLD):
        prim = prims["leaf" if solid.name == DOOR else solid.name]
        matrix = places.GetLocalToWorldTransform(prim)
        np.testing.assert_allclose(numbers(matrix.ExtractTranslation()), solid.center_m, atol=1e-5)
        corner = matrix.TransformDir(Gf.Vec3d(1, 0, 0))
        if solid.shape == "box":
            along = np.array([math.cos(solid.yaw_rad), math.sin(solid.yaw_rad), 0]) * solid.half_extents_m[0]
            np.testing.assert_allclose(numbers(corner), along, atol=1e-5)
        else:
            assert UsdGeom.Cylinder(prim).GetRadiusAttr().Get() == pytest.approx(solid.half_extents_m[0])
        assert "PhysicsCollisionAPI" in prim.GetAppliedSchemas()


def test_coverings_have_their_pictures_and_do_not_collide(stage: Usd.Stage, tmp_path: Path):
    prims = by_name(stage)
    for sheet in sheets(WORLD):
        prim = prims[sheet.name]
        assert "PhysicsCollisionAPI" not in prim.GetAppliedSchemas()
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        picture = stage.GetPrimAtPath(material.GetPath().AppendChild("picture"))
        texture = texture_of(sheet.finish)
        assert bool(picture) == (texture is not None)
        if texture is not None:
            file = UsdShade.Shader(picture).GetInput("file").Get()
            assert (tmp_path / file.path).read_bytes() == texture.png


def test_a_door_is_a_body_on_a_hinge_that_holds_it_where_it_stands(stage: Usd.Stage):
    hinge = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath(f"/World/Doors/{by_name(stage)[DOOR].GetName()}/hinge"))
    assert tuple(hinge.GetLocalPos0Attr().Get())[:2] == pytest.approx(HINGE_M)
    limits = hinge.GetLowerLimitAttr().Get(), hinge.GetUpperLimitAttr().Get()
    # It opens clockwise, from 90 degrees to 0, and stands at 30 %.
    assert limits == pytest.approx((-63.0, 27.0), abs=1e-4)
    assert "PhysicsRigidBodyAPI" in by_name(stage)[DOOR].GetAppliedSchemas()


@pytest.mark.parametrize("door", [WORLD.doors[0], other_hand(WORLD.doors[0])], ids=["clockwise", "anticlockwise"])
def test_a_hinge_holds_its_door_as_it_stands_and_turns_it_shut_and_open(tmp_path: Path, door: Door):
    stage = Usd.Stage.Open(str(written(WORLD.model_copy(update={"doors": (door,)}), tmp_path)))
    body = by_name(stage)[DOOR]
    hinge = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath(body.GetPath().AppendChild("hinge")))
    held = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Quatd(hinge.GetLocalRot0Attr().Get())))
    stands = UsdGeom.XformCache().GetLocalToWorldTransform(body)
    along = numbers(held.TransformDir(Gf.Vec3d(1, 0, 0)))
    np.testing.assert_allclose(along, numbers(stands.TransformDir(Gf.Vec3d(1, 0, 0))), atol=1e-6)
    assert hinge.GetLocalRot1Attr().Get() == Gf.Quatf(1)
    stands_deg = math.degrees(math.atan2(along[1], along[0]))
    ends = sorted(math.degrees(end) for end in (door.closed_yaw_rad, door.open_yaw_rad))
    limits = hinge.GetLowerLimitAttr().Get(), hinge.GetUpperLimitAttr().Get()
    assert [stands_deg + limit for limit in limits] == pytest.approx(ends, abs=1e-4)


def test_coverings_are_seen_from_within_their_rooms(stage: Usd.Stage):
    prims, rooms = by_name(stage), {room.name: room.floor for room in WORLD.rooms}
    for sheet in sheets(WORLD):
        mesh, floor = UsdGeom.Mesh(prims[sheet.name]), rooms[sheet.name.partition("/")[2]]
        assert mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.rightHanded
        corners = np.array(mesh.GetPointsAttr().Get())[np.array(mesh.GetFaceVertexIndicesAttr().Get())].reshape(
            -1, 3, 3
        )
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middle_m = ((floor.x_min_m + floor.x_max_m) / 2, (floor.y_min_m + floor.y_max_m) / 2, 1.3)
        assert np.all(np.sum(facing * (middle_m - corners[:, 0]), axis=1) > 0)


def test_there_is_a_light_for_every_lamp(stage: Usd.Stage):
    lights = [prim for prim in stage.Traverse() if prim.GetTypeName() == "SphereLight"]
    assert len(lights) == len(WORLD.lights)


def test_the_same_world_gives_the_same_bytes():
    assert usd_files(WORLD) == usd_files(WORLD) != usd_files(apartment())
