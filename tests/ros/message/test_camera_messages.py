"""Pictures as ROS has them: rosbags reads what we write, and what a camera says of itself projects what it sees."""

import math
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from tasks.ros.message.camera_messages import (
    Pinhole,
    camera_info,
    compressed_image,
    depths_in_m,
    depths_in_mm,
    image,
    optical_turn,
    point_cloud,
)
from tasks.ros.message.ros_messages import stamp
from tests.ros.message.message_store import round_trip

CAMERA = Pinhole(64, 48, 1.2)


def turn_matrix(quaternion: tuple[float, float, float, float]) -> np.ndarray:
    """Returns the rotation of a quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2 * w * across + 2 * across @ across


@pytest.mark.parametrize(
    ("pixels", "encoding", "pixel_bytes"),
    [
        (np.arange(24, dtype=np.uint8).reshape(2, 4, 3), "rgb8", 3),
        (np.arange(8, dtype=np.uint16).reshape(2, 4) + 300, "16UC1", 2),
        (np.arange(8, dtype=np.float32).reshape(2, 4) / 3, "32FC1", 4),
    ],
)
def test_a_picture_has_its_rows_from_the_upper_left_corner(pixels: np.ndarray, encoding: str, pixel_bytes: int):
    read = round_trip("sensor_msgs/Image", image(7, stamp(1_500_000_000), "eye", pixels))
    assert (read.header.seq, read.header.stamp.nanosec, read.header.frame_id) == (7, 500_000_000, "eye")
    assert (read.height, read.width, read.encoding, read.is_bigendian) == (2, 4, encoding, 0)
    assert read.step == 4 * pixel_bytes
    assert bytes(read.data) == pixels.tobytes()


def test_a_compressed_picture_is_jpeg_as_image_transport_has_it():
    pixels = np.zeros((48, 64, 3), np.uint8)
    pixels[:, 32:] = 200, 100, 50
    read = round_trip("sensor_msgs/CompressedImage", compressed_image(7, stamp(0), "eye", pixels))
    assert (read.header.frame_id, read.format) == ("eye", "rgb8; jpeg compressed bgr8")
    again = np.asarray(Image.open(BytesIO(bytes(read.data))))
    assert np.abs(again.astype(int) - pixels)[:, [0, 20, 44, 63]].max() <= 4


def test_what_no_pixel_sees_is_inf_in_metres_and_0_in_millimetres():
    depth_m = np.array([[1.2344, 0.0, 10.0], [70.0, 65.5, np.inf]], np.float32)
    assert depths_in_m(depth_m, 10.0).tolist() == [[np.float32(1.2344), 0.0, np.inf], [np.inf] * 3]
    assert depths_in_mm(depth_m, 100.0).tolist() == [[1234, 0, 10_000], [0, 65_500, 0]]
    assert depths_in_mm(depth_m, 10.0).tolist() == [[1234, 0, 0], [0, 0, 0]]
    assert depth_m[0, 2] == 10.0, "what was seen stays as it was"


def test_points_of_a_wall_ahead_are_in_its_plane_and_where_pixels_look():
    depth_m = np.full((CAMERA.rows, CAMERA.columns), 2.0, np.float32)
    depth_m[0, 0] = np.inf
    read = round_trip("sensor_msgs/PointCloud2", point_cloud(1, stamp(0), "eye", CAMERA, depth_m))
    assert [(each.name, each.offset, each.datatype, each.count) for each in read.fields] == [
        (name, 4 * place, 7, 1) for place, name in enumerate("xyz")
    ]
    assert (read.height, read.width, read.point_step, read.row_step, read.is_dense) == (48, 64, 12, 768, False)
    points = np.frombuffer(bytes(read.data), np.float32).reshape(48, 64, 3)
    assert np.isnan(points[0, 0]).all()
    assert (points[1:, :, 2] == 2.0).all()
    half_m = 2.0 * math.tan(0.6)
    assert points[9, -1, 0] == -points[9, 0, 0] == pytest.approx(half_m * 63 / 64)
    assert points[-1, 9, 1] == pytest.approx(half_m * 47 / 64), "down is positive"


@pytest.mark.parametrize(("yaw_rad", "pitch_rad"), [(0.0, 0.0), (0.7, 0.0), (0.0, 0.4), (-2.1, -0.9)])
def test_an_optical_frame_looks_along_z_with_x_to_the_right(yaw_rad: float, pitch_rad: float):
    found = turn_matrix(optical_turn(yaw_rad, pitch_rad))
    cos, sin = math.cos(pitch_rad), math.sin(pitch_rad)
    ahead = [cos * math.cos(yaw_rad), cos * math.sin(yaw_rad), -sin]
    np.testing.assert_allclose(found[:, 2], ahead, atol=1e-12)
    np.testing.assert_allclose(found[:, 0], [math.sin(yaw_rad), -math.cos(yaw_rad), 0.0], atol=1e-12)
    np.testing.assert_allclose(np.cross(found[:, 0], found[:, 1]), found[:, 2], atol=1e-12)


def test_camera_info_has_no_distortion_and_the_middle_ahead():
    read = round_trip("sensor_msgs/CameraInfo", camera_info(3, stamp(0), "eye", CAMERA))
    assert (read.height, read.width, read.distortion_model, read.D.tolist()) == (48, 64, "plumb_bob", [0.0] * 5)
    focal = 32 / math.tan(0.6)
    np.testing.assert_allclose(read.K.reshape(3, 3), [[focal, 0, 31.5], [0, focal, 23.5], [0, 0, 1]])
    np.testing.assert_array_equal(read.P.reshape(3, 4)[:, :3], read.K.reshape(3, 3))
    np.testing.assert_array_equal(read.R.reshape(3, 3), np.eye(3))
