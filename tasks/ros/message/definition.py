"""Definitions of the ROS 1 messages and services that the robot speaks: their fields, digests and full text.

The digest of a type is the MD5 of its definition without comments, in which each field of another message type is
replaced by that type's digest (wiki.ros.org/ROS/Technical%20Overview, "Message serialization and msg MD5
sums"). Two nodes exchange messages only if their digests are equal.
"""

import hashlib
import re
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

ANY = "*"
_PRIMITIVE = re.compile(r"(bool|u?int(8|16|32|64)|float(32|64)|string|time|duration|byte|char)$")
_RULE = "=" * 80

MESSAGES: Mapping[str, str] = MappingProxyType(
    {
        "actionlib_msgs/GoalID": "time stamp\nstring id",
        "actionlib_msgs/GoalStatus": (
            "uint8 PENDING=0\nuint8 ACTIVE=1\nuint8 PREEMPTED=2\nuint8 SUCCEEDED=3\nuint8 ABORTED=4\nuint8 REJECTED=5\n"
            "uint8 PREEMPTING=6\nuint8 RECALLING=7\nuint8 RECALLED=8\nuint8 LOST=9\n"
            "GoalID goal_id\nuint8 status\nstring text"
        ),
        "gazebo_msgs/ModelState": (
            "string model_name\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\nstring reference_frame"
        ),
        "gazebo_msgs/ModelStates": "string[] name\ngeometry_msgs/Pose[] pose\ngeometry_msgs/Twist[] twist",
        "gazebo_msgs/ODEPhysics": (
            "bool auto_disable_bodies\nuint32 sor_pgs_precon_iters\nuint32 sor_pgs_iters\nfloat64 sor_pgs_w\n"
            "float64 sor_pgs_rms_error_tol\nfloat64 contact_surface_layer\nfloat64 contact_max_correcting_vel\n"
            "float64 cfm\nfloat64 erp\nuint32 max_contacts"
        ),
        "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
        "geometry_msgs/Pose": "Point position\nQuaternion orientation",
        "geometry_msgs/PoseStamped": "Header header\nPose pose",
        "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
        "geometry_msgs/PoseWithCovarianceStamped": "Header header\nPoseWithCovariance pose",
        "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation",
        "geometry_msgs/TransformStamped": "Header header\nstring child_frame_id\nTransform transform",
        "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
        "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
        "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
        "move_base_msgs/MoveBaseActionGoal": "Header header\nactionlib_msgs/GoalID goal_id\nMoveBaseGoal goal",
        "move_base_msgs/MoveBaseActionResult": "Header header\nactionlib_msgs/GoalStatus status\nMoveBaseResult result",
        "move_base_msgs/MoveBaseGoal": "geometry_msgs/PoseStamped target_pose",
        "move_base_msgs/MoveBaseResult": "",
        "nav_msgs/MapMetaData": (
            "time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin"
        ),
        "nav_msgs/OccupancyGrid": "Header header\nMapMetaData info\nint8[] data",
        "nav_msgs/Odometry": (
            "Header header\nstring child_frame_id\n"
            "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
        ),
        "robomaker_simulation_msgs/Tag": "string key\nstring value",
        "rosgraph_msgs/Clock": "time clock",
        "sensor_msgs/CameraInfo": (
            "Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] D\nfloat64[9] K\n"
            "float64[9] R\nfloat64[12] P\nuint32 binning_x\nuint32 binning_y\nRegionOfInterest roi"
        ),
        "sensor_msgs/CompressedImage": "Header header\nstring format\nuint8[] data",
        "sensor_msgs/Image": (
            "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data"
        ),
        "sensor_msgs/Imu": (
            "Header header\n"
            "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
            "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
            "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
        ),
        "sensor_msgs/JointState": (
            "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
        ),
        "sensor_msgs/LaserScan": (
            "Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\n"
            "float32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities"
        ),
        "sensor_msgs/MagneticField": (
            "Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance"
        ),
        "sensor_msgs/NavSatFix": (
            "uint8 COVARIANCE_TYPE_UNKNOWN=0\nuint8 COVARIANCE_TYPE_APPROXIMATED=1\n"
            "uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\nuint8 COVARIANCE_TYPE_KNOWN=3\nHeader header\n"
            "NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
            "float64[9] position_covariance\nuint8 position_covariance_type"
        ),
        "sensor_msgs/NavSatStatus": (
            "int8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 STATUS_SBAS_FIX=1\nint8 STATUS_GBAS_FIX=2\n"
            "uint16 SERVICE_GPS=1\nuint16 SERVICE_GLONASS=2\nuint16 SERVICE_COMPASS=4\nuint16 SERVICE_GALILEO=8\n"
            "int8 status\nuint16 service"
        ),
        "sensor_msgs/PointCloud2": (
            "Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\nuint32 point_step\n"
            "uint32 row_step\nuint8[] data\nbool is_dense"
        ),
        "sensor_msgs/PointField": (
            "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n"
            "uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count"
        ),
        "sensor_msgs/Range": (
            "uint8 ULTRASOUND=0\nuint8 INFRARED=1\nHeader header\nuint8 radiation_type\nfloat32 field_of_view\n"
            "float32 min_range\nfloat32 max_range\nfloat32 range"
        ),
        "sensor_msgs/RegionOfInterest": (
            "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"
        ),
        "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id",
        "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
        "std_msgs/MultiArrayLayout": "MultiArrayDimension[] dim\nuint32 data_offset",
        "std_msgs/UInt8MultiArray": "MultiArrayLayout layout\nuint8[] data",
        "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    }
)

# Request and response.
SERVICES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "gazebo_msgs/GetModelState": (
            "string model_name\nstring relative_entity_name",
            "Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\nbool success\nstring status_message",
        ),
        "gazebo_msgs/GetPhysicsProperties": (
            "",
            "float64 time_step\nbool pause\nfloat64 max_update_rate\ngeometry_msgs/Vector3 gravity\n"
            "gazebo_msgs/ODEPhysics ode_config\nbool success\nstring status_message",
        ),
        "gazebo_msgs/GetWorldProperties": (
            "",
            "float64 sim_time\nstring[] model_names\nbool rendering_enabled\nbool success\nstring status_message",
        ),
        "gazebo_msgs/SetModelState": ("gazebo_msgs/ModelState model_state", "bool success\nstring status_message"),
        "gazebo_msgs/SetPhysicsProperties": (
            "float64 time_step\nfloat64 max_update_rate\ngeometry_msgs/Vector3 gravity\n"
            "gazebo_msgs/ODEPhysics ode_config",
            "bool success\nstring status_message",
        ),
        "std_srvs/Empty": ("", ""),
        "robomaker_simulation_msgs/AddTags": ("Tag[] tags", "bool success\nstring message"),
        "robomaker_simulation_msgs/Cancel": ("", "bool success\nstring message"),
        "robomaker_simulation_msgs/ListTags": ("", "bool success\nstring message\nTag[] tags"),
        "robomaker_simulation_msgs/RemoveTags": ("string[] keys", "bool success\nstring message"),
    }
)


@cache
def type_digest(kind: str) -> str:
    """Returns the MD5 digest of a message's or service's type.

    Args:
        kind: Such as ``sensor_msgs/LaserScan``.

    Raises:
        KeyError: If the robot does not speak that type.
    """
    if kind in SERVICES:
        parts = (_digest_text(_package(kind), text) for text in SERVICES[kind])
        return hashlib.md5("".join(parts).encode(), usedforsecurity=False).hexdigest()
    text = _digest_text(_package(kind), MESSAGES[kind])
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


@cache
def definition(kind: str) -> str:
    """Returns the definition of a message with those of all types in it, as connection headers and bags hold it.

    Args:
        kind: Such as ``sensor_msgs/LaserScan``.

    Raises:
        KeyError: If the robot does not speak that type.
    """
    found: list[str] = []
    _collect_types(kind, found)
    parts = [MESSAGES[kind] + "\n"]
    parts += [f"{_RULE}\nMSG: {each}\n{MESSAGES[each]}\n" for each in found if each != kind]
    return "".join(parts)


def _digest_text(package: str, text: str) -> str:
    lines: list[str] = []
    for line in filter(None, text.split("\n")):
        field, name = line.split()
        base = field.partition("[")[0]
        lines.append(line if _PRIMITIVE.match(base) else f"{type_digest(_full_name(package, base))} {name}")
    return "\n".join(lines)


def _collect_types(kind: str, found: list[str]) -> None:
    if kind in found:
        return
    found.append(kind)
    for line in filter(None, MESSAGES[kind].split("\n")):
        base = line.split()[0].partition("[")[0]
        if not _PRIMITIVE.match(base):
            _collect_types(_full_name(_package(kind), base), found)


def _full_name(package: str, base: str) -> str:
    if base == "Header":
        return "std_msgs/Header"
    return base if "/" in base else f"{package}/{base}"


def _package(kind: str) -> str:
    return kind.partition("/")[0]
