"""A world as USD, readable text: primitives with collision, rooms as meshes with pictures, doors on hinges, lights.

/World                 metres, z up, the default prim
/World/Building/...    walls (collide), windows, coverings of floors and walls
/World/Furniture/...   a piece a scope, its solids below (collide)
/World/Doors/...       rigid bodies on revolute joints, standing as the world says
/World/Lights/...      a sphere light a lamp
/World/Looks/...       materials (UsdPreviewSurface)
"""

import math

from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade, Vt

from specs.data.world import Color, Door, Finish, Solid, World
from tasks.render.sheets import Covering, finish_key, prism_mesh, sheets, window_parts
from tasks.render.textures import texture_of

USD_FILE = "world.usda"
TEXTURE_FOLDER = "textures"
_ROOT = Sdf.Path("/World")
_DENSITY_KG_M3 = 300.0  # as for MJCF (``tasks.export.format.mjcf``)
_LAMP_RADIUS_M, _LAMP_INTENSITY = 0.12, 12_000.0


def usd_files(world: World) -> dict[str, bytes]:
    """Returns the stage as text, and the pictures that it names; the same bytes for the same world."""
    return _Stage(world).files()


_KINDS = {"box": "Cube", "cylinder": "Cylinder", "prism": "Mesh"}


class _Stage:
    """One world being written."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(self._stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self._stage, 1.0)
        UsdPhysics.SetStageKilogramsPerUnit(self._stage, 1.0)
        self._textures: dict[str, bytes] = {}

    def files(self) -> dict[str, bytes]:
        root = UsdGeom.Xform.Define(self._stage, _ROOT)
        self._stage.SetDefaultPrim(root.GetPrim())
        Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
        self._building(self._scope("Building"))
        furniture = self._scope("Furniture")
        for piece in self._world.furniture:
            group = self._named("Xform", furniture, piece.name)
            Usd.ModelAPI(group).SetKind(Kind.Tokens.component)
            _place(group, (*piece.center_m, 0.0))
            for solid in piece.solids:
                self._solid(group.GetPath(), solid, origin_m=piece.center_m)
        doors = self._scope("Doors")
        for door in self._world.doors:
            self._door(doors, door)
        self._lights(self._scope("Lights"))
        text: str = self._stage.GetRootLayer().ExportToString()
        return {USD_FILE: text.encode(), **self._textures}

    def _building(self, scope: Sdf.Path) -> None:
        Usd.ModelAPI(self._stage.GetPrimAtPath(scope)).SetKind(Kind.Tokens.group)
        for wall in self._world.walls:
            self._solid(scope, wall)
        for room in self._world.rooms:
            for part in window_parts(self._world, room):
                self._solid(scope, part, touched=False)
        for sheet in sheets(self._world):
            self._sheet(scope, sheet)
        ground = UsdGeom.Plane.Define(self._stage, scope.AppendChild("ground"))
        ground.CreateAxisAttr(UsdGeom.Tokens.z)
        ground.CreatePurposeAttr(UsdGeom.Tokens.guide)  # collides, is not drawn
        UsdPhysics.CollisionAPI.Apply(ground.GetPrim())

    def _scope(self, name: str) -> Sdf.Path:
        prim = UsdGeom.Xform.Define(self._stage, _ROOT.AppendChild(name)).GetPrim()
        Usd.ModelAPI(prim).SetKind(Kind.Tokens.group)
        return prim.GetPath()

    def _named(self, kind: str, parent: Sdf.Path, name: str) -> UsdGeom.Xformable:
        """Returns a new prim; a name that USD does not allow is changed, and kept for people to see.

        Args:
            kind: Type of schema, such as ``Cube``.
            parent: Where it goes.
            name: Its name in the world.
        """
        valid = Tf.MakeValidIdentifier(name)
        number = 1
        while self._stage.GetPrimAtPath(parent.AppendChild(valid)):
            number += 1
            valid = f"{Tf.MakeValidIdentifier(name)}_{number}"
        found = self._stage.DefinePrim(parent.AppendChild(valid), kind)
        if valid != name:
            found.SetDisplayName(name)
        return UsdGeom.Xformable(found)

    def _solid(
        self, parent: Sdf.Path, solid: Solid, *, origin_m: tuple[float, float] = (0.0, 0.0), touched: bool = True
    ) -> None:
        half_m = solid.half_extents_m
        shape = self._named(_KINDS[solid.shape], parent, solid.name)
        place_m = (solid.center_m[0] - origin_m[0], solid.center_m[1] - origin_m[1], solid.center_m[2])
        _place(shape, place_m, solid.yaw_rad)
        extent = half_m
        if solid.shape == "prism":
            corners, faces = prism_mesh(solid)
            mesh = UsdGeom.Mesh(shape)
            mesh.CreatePointsAttr([Gf.Vec3f(*corner) for corner in corners.tolist()])
            mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
            mesh.CreateFaceVertexIndicesAttr([corner for face in faces for corner in face])
            mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        elif solid.shape == "cylinder":
            drum = UsdGeom.Cylinder(shape)
            drum.CreateAxisAttr(UsdGeom.Tokens.z)
            drum.CreateRadiusAttr(half_m[0])
            drum.CreateHeightAttr(2 * half_m[2])
        else:
            UsdGeom.Cube(shape).CreateSizeAttr(2.0)
            shape.AddScaleOp().Set(Gf.Vec3f(*half_m))
            extent = (1.0, 1.0, 1.0)
        gprim = UsdGeom.Gprim(shape)
        gprim.CreateExtentAttr([Gf.Vec3f(*(-side for side in extent)), Gf.Vec3f(*extent)])
        gprim.CreateDisplayColorAttr([Gf.Vec3f(*map(_linear, solid.color))])
        _bind(shape, self._plain(solid.color))
        if touched:
            UsdPhysics.CollisionAPI.Apply(shape.GetPrim())
            if solid.shape == "prism":
                hull = UsdPhysics.MeshCollisionAPI.Apply(shape.GetPrim())
                hull.CreateApproximationAttr(UsdPhysics.Tokens.convexHull)

    def _sheet(self, parent: Sdf.Path, sheet: Covering) -> None:
        mesh = UsdGeom.Mesh(self._named("Mesh", parent, sheet.name))
        points = [Gf.Vec3f(*corner) for corner in sheet.vertices_m.tolist()]
        mesh.CreatePointsAttr(points)
        mesh.CreateFaceVertexCountsAttr([3] * len(sheet.triangles))
        mesh.CreateFaceVertexIndicesAttr(sheet.triangles.ravel().tolist())
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
        coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.varying
        )
        coordinates.Set(Vt.Vec2fArray([Gf.Vec2f(*each) for each in sheet.coordinates.tolist()]))
        _bind(mesh, self._finish(sheet.finish))

    def _door(self, parent: Sdf.Path, door: Door) -> None:
        body = self._named("Xform", parent, door.name)
        Usd.ModelAPI(body).SetKind(Kind.Tokens.component)
        _place(body, (*door.hinge_m, 0.0), door.leaf.yaw_rad)
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        UsdPhysics.MassAPI.Apply(body.GetPrim()).CreateDensityAttr(_DENSITY_KG_M3)
        self._solid(body.GetPath(), _in_frame(door))
        hinge = UsdPhysics.RevoluteJoint.Define(self._stage, body.GetPath().AppendChild("hinge"))
        hinge.CreateAxisAttr(UsdPhysics.Tokens.z)
        hinge.CreateBody1Rel().SetTargets([body.GetPath()])
        # Without a first body the joint holds to the world: its frame there is where the leaf stands now.
        hinge.CreateLocalPos0Attr(Gf.Vec3f(*door.hinge_m, 0.0))
        half_rad = door.leaf.yaw_rad / 2
        hinge.CreateLocalRot0Attr(Gf.Quatf(math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)))
        quarter_rad = math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 2 * math.pi)
        shut_deg = math.degrees(-quarter_rad * door.open_percent / 100.0)
        open_deg = shut_deg + math.degrees(quarter_rad)
        hinge.CreateLowerLimitAttr(min(shut_deg, open_deg))
        hinge.CreateUpperLimitAttr(max(shut_deg, open_deg))

    def _lights(self, parent: Sdf.Path) -> None:
        for number, lamp in enumerate(self._world.lights, start=1):
            light = UsdLux.SphereLight.Define(self._stage, parent.AppendChild(f"light_{number}"))
            light.CreateRadiusAttr(_LAMP_RADIUS_M)
            light.CreateIntensityAttr(_LAMP_INTENSITY)
            _place(light, lamp.position_m)

    def _plain(self, color: Color) -> UsdShade.Material:
        name = "color_" + "".join(f"{round(255 * channel):02x}" for channel in color)
        return self._material(name, color, None)

    def _finish(self, finish: Finish) -> UsdShade.Material:
        texture = texture_of(finish)
        if texture is None:
            return self._plain(finish.color)
        key = finish_key(finish)
        self._textures[f"{TEXTURE_FOLDER}/{key}.png"] = texture.png
        return self._material(key, finish.color, f"{TEXTURE_FOLDER}/{key}.png")

    def _material(self, name: str, color: Color, picture: str | None) -> UsdShade.Material:
        """Returns the material of a name, made when it is first asked for."""
        path = _ROOT.AppendChild("Looks").AppendChild(Tf.MakeValidIdentifier(name))
        if self._stage.GetPrimAtPath(path):
            return UsdShade.Material.Get(self._stage, path)
        UsdGeom.Scope.Define(self._stage, path.GetParentPath())
        material = UsdShade.Material.Define(self._stage, path)
        shader = UsdShade.Shader.Define(self._stage, path.AppendChild("surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
        base = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
        if picture is None:
            base.Set(Gf.Vec3f(*map(_linear, color)))
        else:
            base.ConnectToSource(self._sampled(path, picture))
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        return material

    def _sampled(self, path: Sdf.Path, picture: str) -> UsdShade.Output:
        reader = UsdShade.Shader.Define(self._stage, path.AppendChild("coordinates"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        sampler = UsdShade.Shader.Define(self._stage, path.AppendChild("picture"))
        sampler.CreateIdAttr("UsdUVTexture")
        sampler.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(picture))
        sampler.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        for axis in ("wrapS", "wrapT"):
            sampler.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("repeat")
        sampler.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        return sampler.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)


def _in_frame(door: Door) -> Solid:
    """Returns a door's leaf in the frame of its hinge, turned with it."""
    x_m, y_m = (door.leaf.center_m[axis] - door.hinge_m[axis] for axis in (0, 1))
    cos, sin = math.cos(-door.leaf.yaw_rad), math.sin(-door.leaf.yaw_rad)
    center_m = (round(cos * x_m - sin * y_m, 6), round(sin * x_m + cos * y_m, 6), door.leaf.center_m[2])
    return door.leaf.model_copy(update={"name": "leaf", "center_m": center_m, "yaw_rad": 0.0})


def _place(prim: UsdGeom.Xformable, place_m: tuple[float, float, float], yaw_rad: float = 0.0) -> None:
    form = UsdGeom.Xformable(prim)
    form.AddTranslateOp().Set(Gf.Vec3d(*place_m))
    if yaw_rad:
        form.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble).Set(math.degrees(yaw_rad))


def _bind(prim: UsdGeom.Xformable, material: UsdShade.Material) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)


def _linear(channel: float) -> float:
    """Returns a channel of sRGB as linear light (IEC 61966-2-1)."""
    return channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
