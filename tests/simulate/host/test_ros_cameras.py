"""What nodes are told of a camera says where in its pictures a box stands: CameraInfo, and the frames of /tf."""

import math
from types import SimpleNamespace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from jaxtyping import Bool, Float

from specs.bundle_files import LidarDeclaration
from specs.ros_robot import RosDepthCamera, RosRobot
from tasks.ros.lockstep.exchange import RobotBase, Sensed
from tasks.ros.lockstep.robot_topics import STATIC, TRANSFORMS, SensorMessages
from tasks.ros.lockstep.sensor_topics import Moment
from tasks.simulate.geometry.depth_picture import DepthScene, pad_scenes
from tasks.simulate.host.ros_controllers import declared_sensors
from tasks.simulate.sensors.depth_camera import pictures_again
from tasks.simulate.sensors.sensor import seed_words
from tasks.simulate.sensors.sensor_table import sensors_of
from tests.ros.message.message_store import round_trip

POSE = (0.4, -0.3, 0.5)
# x, y, lowest, highest, half x, half y, cos yaw, sin yaw: about 2 m ahead of the robot.
BOX = (2.1, 0.7, 0.1, 0.6, 0.25, 0.15, math.cos(0.3), math.sin(0.3))
EDGE_PX = 0.02


def scene(*boxes: tuple[float, ...]) -> DepthScene:
    kinds = (np.array(given, np.float32).reshape(-1, n) for given, n in ((boxes, 8), ((), 5), ((), 29)))
    return pad_scenes([DepthScene(*kinds, ceiling_m=np.array([2.5], np.float32))])[0]


def corners() -> Float[np.ndarray, "8 3"]:
    x, y, low, high, half_x, half_y, cos, sin = BOX
    ends = [(a * half_x, b * half_y, z) for a in (-1, 1) for b in (-1, 1) for z in (low, high)]
    return np.array([(x + cos * a - sin * b, y + sin * a + cos * b, z) for a, b, z in ends])


def frames(data: bytes) -> dict[str, np.ndarray]:
    """Returns where frames are in their parents, as matrices of four rows, by name."""
    found: dict[str, np.ndarray] = {}
    for each in round_trip("tf2_msgs/TFMessage", data).transforms:
        q, place, matrix = each.transform.rotation, each.transform.translation, np.eye(4)
        across = np.array([[0.0, -q.z, q.y], [q.z, 0.0, -q.x], [-q.y, q.x, 0.0]])
        matrix[:3, :3] += 2 * q.w * across + 2 * across @ across
        matrix[:3, 3] = place.x, place.y, place.z
        found[each.child_frame_id] = matrix
    return found


class Told(NamedTuple):
    """What nodes are told at a moment, and what the picture would be without the box.

    Attributes:
        messages: Writes what nodes are told.
        moment: Then.
        eye: The optical frame in the world's, as the transforms have it.
        shows_box: Which pixels show the box.
    """

    messages: SensorMessages
    moment: Moment
    eye: Float[np.ndarray, "4 4"]
    shows_box: Bool[np.ndarray, "rows columns"]

    def read(self, kind: str, name: str) -> SimpleNamespace:
        """Returns one of the camera's messages."""
        return round_trip(f"sensor_msgs/{kind}", self.messages.write(f"/camera/depth/{name}", self.moment))


def told(camera: RosDepthCamera) -> Told:
    robot = RosRobot(depth_camera=camera, lidar=LidarDeclaration(rays=4))
    seen = sensors_of(declared_sensors(robot)).depth_camera
    assert seen is not None
    poses, steps, seed = jnp.array([POSE], jnp.float32), jnp.zeros(1, jnp.int32), jnp.asarray(seed_words(1))
    empty, full = (
        np.asarray(pictures_again(seen, each, seed, poses, steps, jnp.zeros((1, 0, 5))))[0]
        for each in (scene(), scene(BOX))
    )
    zeros, readings = np.zeros(3), {"depth_m": full}
    sensed = Sensed(np.array(POSE), zeros, zeros[:2], np.ones(4), np.zeros(0, bool), zeros[:2], None, readings)
    messages = SensorMessages(RobotBase(robot, 4, 0.0, 1.0, 8.0), 0.05)
    moment = Moment(0, 1_000_000_000, sensed)
    mounted, base = frames(messages.fixed(moment, None)[STATIC]), frames(messages.write(TRANSFORMS, moment))
    return Told(messages, moment, base["base_link"] @ mounted[robot.frames.depth_camera], full < empty)


@pytest.mark.parametrize(
    "camera",
    [
        RosDepthCamera(columns=96, rows=72, z_m=0.35, x_m=0.1),
        RosDepthCamera(columns=80, rows=61, fov_rad=1.4, z_m=0.9, x_m=0.1, y_m=-0.05, pitch_rad=0.35, yaw_rad=-0.2),
    ],
    ids=["level", "turned"],
)
def test_camera_info_projects_the_corners_of_a_box_to_where_the_picture_has_them(camera: RosDepthCamera):
    found = told(camera)
    info = found.read("CameraInfo", "camera_info")
    assert info.header.frame_id == "camera_depth_optical_frame"
    projected = info.P.reshape(3, 4) @ np.linalg.inv(found.eye) @ np.c_[corners(), np.ones(8)].T
    outline = shapely.MultiPoint((projected[:2] / projected[2]).T).convex_hull
    rows, columns = np.nonzero(found.shows_box)
    assert len(rows) > 100
    ends_px = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
    assert np.abs(ends_px - outline.bounds).max() <= 1.0, "within a pixel"
    pixels = shapely.points(*np.meshgrid(np.arange(info.width), np.arange(info.height)))
    clear = shapely.distance(shapely.boundary(outline), pixels) > EDGE_PX
    np.testing.assert_array_equal(shapely.contains(outline, pixels)[clear], found.shows_box[clear])


def test_points_of_a_cloud_lie_on_the_box_that_they_show():
    found = told(RosDepthCamera(columns=48, rows=36, z_m=0.35, x_m=0.1, pitch_rad=0.1))
    cloud = found.read("PointCloud2", "points")
    points = np.frombuffer(bytes(cloud.data), np.float32).reshape(cloud.height, cloud.width, 3)[found.shows_box]
    assert len(points) > 50
    x, y, z = (found.eye @ np.c_[points, np.ones(len(points))].T)[:3]
    middle_x, middle_y, low, high, half_x, half_y, cos, sin = BOX
    ahead = np.abs(cos * (x - middle_x) + sin * (y - middle_y)) - half_x
    left = np.abs(cos * (y - middle_y) - sin * (x - middle_x)) - half_y
    above = np.abs(z - (low + high) / 2) - (high - low) / 2
    np.testing.assert_allclose(np.max([ahead, left, above], axis=0), 0.0, atol=1e-4)


def test_each_camera_of_a_list_tells_what_it_sees_on_topics_and_in_a_frame_of_its_own():
    cameras = [{"name": "front", "columns": 6, "rows": 4}, {"name": "rear", "columns": 6, "rows": 4, "yaw_rad": 3.0}]
    declared = {"depth_camera": cameras, "color_camera": [{**each, "fov_rad": 0.8} for each in cameras]}
    robot = RosRobot.model_validate({**declared, "lidar": None})
    depths = np.linspace(0.5, 2.0, 48, dtype=np.float32).reshape(2, 4, 6)
    colors = np.arange(144, dtype=np.uint8).reshape(2, 4, 6, 3)
    zeros, readings = np.zeros(3), {"depth_m": depths, "color": colors}
    sensed = Sensed(zeros, zeros, zeros[:2], np.ones(0), np.zeros(0, bool), zeros[:2], None, readings)
    messages = SensorMessages(RobotBase(robot, 0, 0.0, 1.0, 8.0), 0.05)
    moment = Moment(0, 1_000_000_000, sensed)
    mounted = frames(messages.fixed(moment, None)[STATIC])
    for place, name in enumerate(("front", "rear")):
        image = round_trip("sensor_msgs/Image", messages.write(f"/{name}/camera/depth/image_raw", moment))
        np.testing.assert_array_equal(image.data.view("<f4").reshape(4, 6), depths[place])
        assert image.header.frame_id == f"{name}_camera_depth_optical_frame"
        cloud = round_trip("sensor_msgs/PointCloud2", messages.write(f"/{name}/camera/depth/points", moment))
        np.testing.assert_array_equal(cloud.data.view("<f4").reshape(4, 6, 3)[..., 2], depths[place])
        image = round_trip("sensor_msgs/Image", messages.write(f"/{name}/camera/color/image_raw", moment))
        np.testing.assert_array_equal(image.data.reshape(4, 6, 3), colors[place])
        info = round_trip("sensor_msgs/CameraInfo", messages.write(f"/{name}/camera/color/camera_info", moment))
        assert info.P[0] == pytest.approx(3 / math.tan(0.4))
        ahead = mounted[f"{name}_camera_depth_optical_frame"][:2, 2]
        np.testing.assert_allclose(ahead, [math.cos(3.0 * place), math.sin(3.0 * place)], atol=1e-6)
        assert f"/{name}/camera/color/image_raw/compressed" in {each.name for each in messages.topics}
