"""ROS 2 messages from lines of `grim track --format jsonl`, or from `grimnet.TrackPoint.to_dict()`.

Values of `geometry_msgs/PoseWithCovarianceStamped` and `sensor_msgs/NavSatFix` as nested dictionaries, and `fill`, which puts them
into messages. Nothing of ROS is needed to make them.

Conventions:
- REP 103: x east, y north, z up; yaw is 0 towards the east and grows counterclockwise. Metres, radians, m^2, rad^2.
- REP 105: both messages are of the aircraft, `base_link`. A position of the ground at the photo's centre is that of another point, tens of
  metres away, and is not made into one.
- REP 105: the pose is in a world-fixed frame, `map`, whose origin the caller chooses.
- `PoseWithCovariance.covariance` is 6 x 6, row by row: x, y, z, rotation about x, y, z. It has no value for "unknown": what is not
  measured has the variance UNKNOWN_VARIANCE, so that a filter gives it no weight. Zero would say that it is exact.
- `NavSatFix.position_covariance` is 3 x 3, row by row: east, north, up. Altitude is above the WGS 84 ellipsoid, NaN if unknown.
"""

import datetime
import math

# A standard deviation of a kilometre, or of many turns.
UNKNOWN_VARIANCE = 1e6
# Standard deviation of a heading whose line does not state it, degrees.
HEADING_SIGMA_DEG = 5.0

# sensor_msgs/NavSatStatus
STATUS_NO_FIX = -1
STATUS_FIX = 0
# No satellite system: 0 since ROS 2 Iron is SERVICE_UNKNOWN.
SERVICE_NONE = 0
# sensor_msgs/NavSatFix
COVARIANCE_TYPE_UNKNOWN = 0
COVARIANCE_TYPE_KNOWN = 3

# WGS 84: semi-major axis in metres, and the square of the first eccentricity.
WGS84_A_M = 6378137.0
WGS84_E2 = 6.69437999014e-3


def stamp(line):
    """`builtin_interfaces/Time` of a line: RFC 3339 in UTC, or seconds."""
    time = line.get("time", line.get("time_s"))
    if isinstance(time, str):
        since_1970 = datetime.datetime.fromisoformat(time.replace("Z", "+00:00")) - datetime.datetime.fromtimestamp(0, datetime.timezone.utc)
        total_us = since_1970 // datetime.timedelta(microseconds=1)
        return {"sec": total_us // 1_000_000, "nanosec": total_us % 1_000_000 * 1000}
    total_ns = round(time * 1e9)
    return {"sec": total_ns // 1_000_000_000, "nanosec": total_ns % 1_000_000_000}


def has_position(line):
    """Whether the line has a position that may be used: in the states `tracking` and `coasting`."""
    return line.get("lat_deg") is not None and line.get("lon_deg") is not None


def is_aircraft(line):
    """Whether the position is that of the aircraft, and not that of the ground at the photo's centre."""
    return str(line.get("position_of")).startswith("aircraft")


def has_aircraft_position(line):
    """Whether the line has a position of the aircraft that may be used."""
    return has_position(line) and is_aircraft(line)


def nav_sat_fix(line, frame_id="base_link", geoid_height_m=None):
    """`sensor_msgs/NavSatFix`. A line without a position of the aircraft becomes a message with STATUS_NO_FIX.

    `geoid_height_m` is the height of the geoid above the ellipsoid; with it an altitude above mean sea level becomes one above the
    ellipsoid.
    """
    found = has_aircraft_position(line)
    altitude_m = math.nan
    if found and geoid_height_m is not None and line.get("altitude_amsl_m") is not None:
        altitude_m = line["altitude_amsl_m"] + geoid_height_m
    ee, en, nn = line["covariance_en_m2"] if found else (0.0, 0.0, 0.0)
    up = UNKNOWN_VARIANCE if found else 0.0
    return {
        "header": {"stamp": stamp(line), "frame_id": frame_id},
        "status": {"status": STATUS_FIX if found else STATUS_NO_FIX, "service": SERVICE_NONE},
        "latitude": line["lat_deg"] if found else math.nan,
        "longitude": line["lon_deg"] if found else math.nan,
        "altitude": altitude_m,
        "position_covariance": [ee, en, 0.0, en, nn, 0.0, 0.0, 0.0, up],
        "position_covariance_type": COVARIANCE_TYPE_KNOWN if found else COVARIANCE_TYPE_UNKNOWN,
    }


def pose_with_covariance_stamped(line, origin, frame_id="map"):
    """`geometry_msgs/PoseWithCovarianceStamped` in the frame whose origin is at `origin`: latitude, longitude (degrees) and, if it
    is known, altitude above mean sea level (metres). `None` for a line without a position of the aircraft.

    The yaw is that of the camera's frame: of the photo's top, or of the gimbal. Roll and pitch are not estimated.
    """
    if not has_aircraft_position(line):
        return None
    east_m, north_m = east_north_m(line["lat_deg"], line["lon_deg"], *origin[:2])
    z_m, z_variance = 0.0, UNKNOWN_VARIANCE
    if len(origin) > 2 and line.get("altitude_amsl_m") is not None:
        # Passed through from the autopilot, whose error is not known.
        z_m = line["altitude_amsl_m"] - origin[2]
    yaw_rad, yaw_variance = 0.0, UNKNOWN_VARIANCE
    if line.get("heading_deg") is not None:
        yaw_rad = math.radians(90.0 - line["heading_deg"])
        sigma_deg = line.get("heading_sigma_deg")
        yaw_variance = math.radians(HEADING_SIGMA_DEG if sigma_deg is None else sigma_deg) ** 2
    covariance = [0.0] * 36
    covariance[0], covariance[1], covariance[7] = line["covariance_en_m2"]
    covariance[6] = covariance[1]
    covariance[14] = z_variance
    covariance[21] = covariance[28] = UNKNOWN_VARIANCE
    covariance[35] = yaw_variance
    return {
        "header": {"stamp": stamp(line), "frame_id": frame_id},
        "pose": {
            "pose": {
                "position": {"x": east_m, "y": north_m, "z": z_m},
                "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)},
            },
            "covariance": covariance,
        },
    }


def east_north_m(lat_deg, lon_deg, origin_lat_deg, origin_lon_deg):
    """Metres east and north of the origin in its tangent plane, both points on the WGS 84 ellipsoid."""

    def earth_centred(lat_deg, lon_deg):
        lat, lon = math.radians(lat_deg), math.radians(lon_deg)
        n = WGS84_A_M / math.sqrt(1 - WGS84_E2 * math.sin(lat) ** 2)
        return n * math.cos(lat) * math.cos(lon), n * math.cos(lat) * math.sin(lon), n * (1 - WGS84_E2) * math.sin(lat)

    dx, dy, dz = (a - b for a, b in zip(earth_centred(lat_deg, lon_deg), earth_centred(origin_lat_deg, origin_lon_deg)))
    lat, lon = math.radians(origin_lat_deg), math.radians(origin_lon_deg)
    east_m = -math.sin(lon) * dx + math.cos(lon) * dy
    north_m = -math.sin(lat) * math.cos(lon) * dx - math.sin(lat) * math.sin(lon) * dy + math.cos(lat) * dz
    return east_m, north_m


def fill(message, values):
    """Puts nested values into a message, and returns it. A field that the message does not have is an error."""
    for name, value in values.items():
        if not hasattr(message, name):
            raise AttributeError(f"{type(message).__name__} has no field {name}")
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message
