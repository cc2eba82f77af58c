"""Define message types of ROS, as files and DDS state them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from palpate.files.mcap.writer import WrittenTopic

RULE = "=" * 80  # between the definitions of types in one text
NUMBERS = ("Float64", "Float32", "UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32")
_STAMPED = "std_msgs/Header header, "
DEFINITIONS: Mapping[str, str] = {
    "builtin_interfaces/Time": "int32 sec, uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec, uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp, string frame_id",
    "std_msgs/Empty": "uint8 structure_needs_at_least_one_member",
    "std_msgs/ColorRGBA": "float32 r, float32 g, float32 b, float32 a",
    "std_msgs/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim, uint32 data_offset",
    **{f"std_msgs/{name}MultiArray": f"std_msgs/MultiArrayLayout layout, {name.lower()}[] data" for name in NUMBERS},
    "geometry_msgs/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/Vector3Stamped": f"{_STAMPED}geometry_msgs/Vector3 vector",
    "geometry_msgs/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force, geometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": f"{_STAMPED}geometry_msgs/Wrench wrench",
    "geometry_msgs/Pose": "geometry_msgs/Point position, geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": f"{_STAMPED}geometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose, float64[36] covariance",
    "geometry_msgs/PoseWithCovarianceStamped": f"{_STAMPED}geometry_msgs/PoseWithCovariance pose",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist, float64[36] covariance",
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular",
    "geometry_msgs/AccelStamped": f"{_STAMPED}geometry_msgs/Accel accel",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation, geometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": f"{_STAMPED}string child_frame_id, geometry_msgs/Transform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": f"{_STAMPED}string[] name, float64[] position, float64[] velocity, float64[] effort",
    "nav_msgs/Odometry": f"{_STAMPED}string child_frame_id, geometry_msgs/PoseWithCovariance pose, "
    "geometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/Imu": f"{_STAMPED}geometry_msgs/Quaternion orientation, float64[9] orientation_covariance, "
    "geometry_msgs/Vector3 angular_velocity, float64[9] angular_velocity_covariance, "
    "geometry_msgs/Vector3 linear_acceleration, float64[9] linear_acceleration_covariance",
    "sensor_msgs/Image": f"{_STAMPED}uint32 height, uint32 width, string encoding, uint8 is_bigendian, uint32 step, "
    "uint8[] data",
    "sensor_msgs/CompressedImage": f"{_STAMPED}string format, uint8[] data",
    "visualization_msgs/UVCoordinate": "float32 u, float32 v",
    "visualization_msgs/MeshFile": "string filename, uint8[] data",
    "visualization_msgs/Marker": f"{_STAMPED}string ns, int32 id, int32 type, int32 action, geometry_msgs/Pose pose, "
    "geometry_msgs/Vector3 scale, std_msgs/ColorRGBA color, builtin_interfaces/Duration lifetime, bool frame_locked, "
    "geometry_msgs/Point[] points, std_msgs/ColorRGBA[] colors, string texture_resource, "
    "sensor_msgs/CompressedImage texture, visualization_msgs/UVCoordinate[] uv_coordinates, string text, "
    "string mesh_resource, visualization_msgs/MeshFile mesh_file, bool mesh_use_embedded_materials",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
    "palpate_msgs/Contact": f"{_STAMPED}int64 sample, int64 contact, int64 candidates, float64 time, "
    "geometry_msgs/Point point, geometry_msgs/Vector3 normal, geometry_msgs/Vector3 force, float64 torque, "
    "float64[9] covariance, uint8 status",
    "palpate_msgs/ContactArray": f"{_STAMPED}palpate_msgs/Contact[] contacts, string[] features, float64[] values",
}
"""Message type, without "/msg/" -> its members in order, as ROS writes them."""


def definition(kind: str) -> str:
    """Return the definition of a message type and of the types in it, as logs have it.

    Raises:
        KeyError: the type is none of `DEFINITIONS`.
    """
    return described(_lines(kind), _kinds(kind)[1:])


def described(own: str, kinds: Iterable[str]) -> str:
    """Return the fields of a message type, followed by the definitions of these types and of those in them.

    Raises:
        KeyError: a type is none of `DEFINITIONS`.
    """
    inner = dict.fromkeys(each for kind in kinds for each in _kinds(kind))
    return own + "".join(f"{RULE}\nMSG: {each}\n{_lines(each)}" for each in inner)


def written_topic(name: str, kind: str) -> WrittenTopic:
    """Return a topic of messages of a type for a file.

    Raises:
        KeyError: the type is none of `DEFINITIONS`.
    """
    return WrittenTopic(name, kind.replace("/", "/msg/"), definition(kind))


def _lines(kind: str) -> str:
    return DEFINITIONS[kind].replace(", ", "\n") + "\n"


def _kinds(kind: str) -> list[str]:
    """Return a message type and those in it, each once."""
    members = (member.split(" ")[0].partition("[")[0] for member in DEFINITIONS[kind].split(", "))
    return list(dict.fromkeys([kind, *(each for name in members if "/" in name for each in _kinds(name))]))
