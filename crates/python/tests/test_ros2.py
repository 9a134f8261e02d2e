"""Messages of examples/ros2 against ROS 2's message definitions, with rosbags as an independent CDR writer and reader."""

import json
import math
import pathlib
import subprocess
import sys
import types

import numpy as np
import pytest

rosbags = pytest.importorskip("rosbags.typesys")

EXAMPLE = pathlib.Path(__file__).resolve().parents[3] / "examples" / "ros2"
sys.path.insert(0, str(EXAMPLE))

import grimnet_ros2  # noqa: E402
import publish  # noqa: E402

ORIGIN = (1.0, 1.5, 20.0)
LINE = {
    "time": "2026-06-21T10:00:07.250Z",
    "state": "tracking",
    "lat_deg": 1.001,
    "lon_deg": 1.502,
    "heading_deg": 30.0,
    "radius95_m": 3.0,
    "covariance_en_m2": [1.5, -0.25, 2.0],
    "altitude_amsl_m": 130.0,
    "position_of": "aircraft",
}


@pytest.fixture(scope="module", params=["ROS2_HUMBLE", "ROS2_JAZZY"])
def store(request):
    return rosbags.get_typestore(getattr(rosbags.Stores, request.param))


def empty(store, name):
    """A message with the fields of its definition, all at their defaults."""
    kind = store.types[name]
    values = types.SimpleNamespace(kind=kind)
    for field, definition in kind.__dataclass_fields__.items():
        if field == "__msgtype__":
            continue
        annotation = str(definition.type)
        nested = next((other for other in store.types if annotation.endswith(other.replace("/", "__"))), None)
        setattr(values, field, empty(store, nested) if nested else None)
    return values


def built(store, name, values):
    """The message, written and read again."""

    def typed(message):
        fields = {}
        for field in message.kind.__dataclass_fields__:
            value = getattr(message, field, None)
            if isinstance(value, types.SimpleNamespace):
                value = typed(value)
            elif isinstance(value, list):
                value = np.array(value, np.float64)
            fields[field] = value
        fields.pop("__msgtype__", None)
        return message.kind(**fields)

    message = typed(grimnet_ros2.fill(empty(store, name), values))
    return store.deserialize_cdr(store.serialize_cdr(message, name), name)


def constants(store, name):
    return {entry[0]: entry[2] for entry in store.fielddefs[name][0]}


def test_nav_sat_fix(store):
    name = "sensor_msgs/msg/NavSatFix"
    read = built(store, name, grimnet_ros2.nav_sat_fix(LINE, geoid_height_m=18.5))
    fixed, statuses = constants(store, name), constants(store, "sensor_msgs/msg/NavSatStatus")
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (1782036007, 250_000_000)
    assert (read.latitude, read.longitude, read.altitude) == (1.001, 1.502, 148.5)
    assert read.status.status == statuses["STATUS_FIX"]
    assert read.status.service & (statuses["SERVICE_GPS"] | statuses["SERVICE_GALILEO"]) == 0
    assert read.position_covariance_type == fixed["COVARIANCE_TYPE_KNOWN"]
    covariance = read.position_covariance.reshape(3, 3)
    assert covariance[:2, :2].tolist() == [[1.5, -0.25], [-0.25, 2.0]]
    assert covariance[2, 2] == grimnet_ros2.UNKNOWN_VARIANCE
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert math.isnan(built(store, name, grimnet_ros2.nav_sat_fix(LINE)).altitude), "above sea level is not above the ellipsoid"


def test_a_line_without_a_position_is_no_fix(store):
    name = "sensor_msgs/msg/NavSatFix"
    lost = {**LINE, "state": "lost", "lat_deg": None, "lon_deg": None, "covariance_en_m2": None, "position_of": None}
    read = built(store, name, grimnet_ros2.nav_sat_fix(lost))
    assert read.status.status == constants(store, "sensor_msgs/msg/NavSatStatus")["STATUS_NO_FIX"]
    assert math.isnan(read.latitude) and math.isnan(read.longitude)
    assert read.position_covariance_type == constants(store, name)["COVARIANCE_TYPE_UNKNOWN"]
    assert grimnet_ros2.pose_with_covariance_stamped(lost, ORIGIN) is None


def test_an_image_centre_is_not_the_aircraft(store):
    name = "sensor_msgs/msg/NavSatFix"
    centre = {**LINE, "position_of": "image_centre"}
    read = built(store, name, grimnet_ros2.nav_sat_fix(centre, geoid_height_m=18.5))
    assert read.status.status == constants(store, "sensor_msgs/msg/NavSatStatus")["STATUS_NO_FIX"]
    assert math.isnan(read.latitude) and math.isnan(read.longitude) and math.isnan(read.altitude)
    assert read.position_covariance_type == constants(store, name)["COVARIANCE_TYPE_UNKNOWN"]
    assert grimnet_ros2.pose_with_covariance_stamped(centre, ORIGIN) is None
    without_attitude = grimnet_ros2.nav_sat_fix({**LINE, "position_of": "aircraft_without_attitude"})
    assert without_attitude["status"]["status"] == grimnet_ros2.STATUS_FIX


def test_pose(store):
    name = "geometry_msgs/msg/PoseWithCovarianceStamped"
    read = built(store, name, grimnet_ros2.pose_with_covariance_stamped(LINE, ORIGIN))
    position, orientation = read.pose.pose.position, read.pose.pose.orientation
    assert read.header.frame_id == "map"
    # A thousandth of a degree at the equator: 110.574 m of latitude, 111.32 m of longitude (WGS 84).
    assert position.x == pytest.approx(2 * 111.32 * math.cos(math.radians(1.001)), abs=0.05)
    assert position.y == pytest.approx(110.574, abs=0.05)
    assert position.z == 110.0
    # A heading of 30 degrees, clockwise from north, is a yaw of 60 degrees, counterclockwise from east.
    forward = (1 - 2 * orientation.z**2, 2 * orientation.z * orientation.w)
    assert forward == pytest.approx((math.sin(math.radians(30)), math.cos(math.radians(30))))
    assert orientation.x == orientation.y == 0.0
    covariance = read.pose.covariance.reshape(6, 6)
    assert np.array_equal(covariance, covariance.T) and np.linalg.eigvalsh(covariance).min() > 0
    assert covariance[:2, :2].tolist() == [[1.5, -0.25], [-0.25, 2.0]]
    assert [covariance[i, i] for i in (2, 3, 4)] == [grimnet_ros2.UNKNOWN_VARIANCE] * 3
    assert covariance[5, 5] == pytest.approx(math.radians(5.0) ** 2)
    certain = grimnet_ros2.pose_with_covariance_stamped({**LINE, "heading_sigma_deg": 1.0}, ORIGIN)
    assert certain["pose"]["covariance"][35] == pytest.approx(math.radians(1.0) ** 2)
    unknown = built(store, name, grimnet_ros2.pose_with_covariance_stamped({**LINE, "heading_deg": None}, ORIGIN))
    assert unknown.pose.covariance[35] == grimnet_ros2.UNKNOWN_VARIANCE and unknown.pose.pose.orientation.w == 1.0


def test_metres_agree_with_the_ellipsoid():
    """A degree at 45 degrees north is 111.132 km of latitude and 78.847 km of longitude (NGA, "Length of a degree")."""
    assert grimnet_ros2.east_north_m(45.005, 11.0, 44.995, 11.0)[1] == pytest.approx(1111.32, abs=0.01)
    assert grimnet_ros2.east_north_m(45.0, 11.01, 45.0, 11.0)[0] == pytest.approx(788.47, abs=0.01)


def test_a_field_that_is_not_defined_is_refused(store):
    with pytest.raises(AttributeError, match="lattitude"):
        grimnet_ros2.fill(empty(store, "sensor_msgs/msg/NavSatFix"), {"lattitude": 1.0})


def test_lines_of_the_program(store, demo):
    with open(demo / "track.jsonl") as lines:
        made = list(publish.messages(lines, ORIGIN))
    with open(demo / "track.jsonl") as lines:
        read = [json.loads(line) for line in lines]
    assert len(made) == len(read) > 10
    for line, (fix, pose) in zip(read, made):
        has_position = line["state"] in ("tracking", "coasting") and grimnet_ros2.is_aircraft(line)
        assert (fix["status"]["status"] == grimnet_ros2.STATUS_FIX) == has_position
        assert (pose is not None) == has_position
        built(store, "sensor_msgs/msg/NavSatFix", fix)
        if pose is not None:
            built(store, "geometry_msgs/msg/PoseWithCovarianceStamped", pose)
    assert any(pose is not None for _, pose in made)


def test_points_of_a_tracker(localizer, demo):
    import grimnet

    tracker = grimnet.Tracker(localizer)
    frames = sorted((demo / "flight").glob("*.jpg"))[:12]
    for second, frame in enumerate(frames):
        point = tracker.frame(frame, float(second))
    fix = grimnet_ros2.nav_sat_fix(point.to_dict())
    assert fix["status"]["status"] == grimnet_ros2.STATUS_FIX and fix["latitude"] == point.lat_deg
    assert fix["header"]["stamp"] == {"sec": 11, "nanosec": 0}


@pytest.mark.parametrize("origin", ["1,1.5", "-24.26,120.72", "-24.26,-120.72,35"])
def test_without_ros_it_says_what_is_missing(origin):
    command = [sys.executable, EXAMPLE / "publish.py", "--origin", origin]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        assert done.stderr.startswith("publish.py: ") and "rclpy" in done.stderr and "ROS 2" in done.stderr


@pytest.mark.parametrize("origin", ["1", "north,east", "124.26,20", "24.26,181", "nan,20", "1,1.5,inf"])
def test_an_origin_that_cannot_be_is_refused(origin):
    command = [sys.executable, EXAMPLE / "publish.py", "--origin", origin]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2 and "argument --origin" in done.stderr and "expected" in done.stderr
