#!/usr/bin/env python3
"""Writes mavlink.txt with pymavlink, nmea.txt with pynmea2 and klv.txt with klvdata: what the unit tests expect.

The values are computed here from the same position, by the autopilots' own formulas, without any code of this crate.
Usage: pip install pymavlink==2.4.50 pynmea2==1.19.0 klvdata==0.0.3; MAVLINK20=1 python make_golden.py
"""

import math
import os
import pathlib

os.environ["MAVLINK20"] = "1"
import klvdata  # noqa: E402
import pynmea2  # noqa: E402
from pymavlink.dialects.v20 import common as mav  # noqa: E402
from pymavlink.rotmat import Matrix3, Vector3  # noqa: E402

NAN = float("nan")
HERE = pathlib.Path(__file__).parent

TIME_S = 1_790_000_000.25  # 2026-09-21 14:13:20.25 UTC
LAT, LON = 24.2634567, 120.7212345
EE, EN, NN = 2.0, 0.5, 3.0
V_EAST, V_NORTH, V_SIGMA = 4.0, -3.0, 0.25
WEIGHT = 0.98
ROLL, PITCH, YAW = 0.1, -0.05, 0.55
DOWN, V_DOWN, AMSL = -120.5, 0.5, 151.25
ORIGIN_LAT, ORIGIN_LON = 24.25, 120.70

SIGMA = math.sqrt(0.5 * (EE + NN) + math.sqrt(0.25 * (EE - NN) ** 2 + EN**2))


def ardupilot_ne():
    """libraries/AP_Common/Location.cpp, get_distance_NE."""
    metres = 0.011131884502145034e7
    scale = math.cos(math.radians(0.5 * (LAT + ORIGIN_LAT)))
    return (LAT - ORIGIN_LAT) * metres, (LON - ORIGIN_LON) * metres * scale


def px4_ne():
    """src/lib/geo/geo.cpp, MapProjection::project."""
    lat, lat0, dlon = math.radians(LAT), math.radians(ORIGIN_LAT), math.radians(LON - ORIGIN_LON)
    arg = math.sin(lat0) * math.sin(lat) + math.cos(lat0) * math.cos(lat) * math.cos(dlon)
    c = math.acos(arg)
    k = c / math.sin(c)
    return (
        k * (math.cos(lat0) * math.sin(lat) - math.sin(lat0) * math.cos(lat) * math.cos(dlon)) * 6371000.0,
        k * math.cos(lat) * math.sin(dlon) * 6371000.0,
    )


def odometry(ne, covariance, frame):
    attitude = Matrix3()
    attitude.from_euler(ROLL, PITCH, YAW)
    body = attitude.transposed() * Vector3(V_NORTH, V_EAST, V_DOWN)
    velocity = [0.0] * 21
    for diagonal in (0, 6, 11):
        velocity[diagonal] = V_SIGMA**2
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (ROLL, PITCH, YAW))
    q = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return mav.MAVLink_odometry_message(
        int(TIME_S * 1e6), frame, mav.MAV_FRAME_BODY_FRD, ne[0], ne[1], DOWN, q, body.x, body.y, body.z,
        NAN, NAN, NAN, covariance, velocity, 3, mav.MAV_ESTIMATOR_TYPE_VISION, 98)


def covariance(values):
    full = [0.0] * 21
    for diagonal in (15, 18, 20):
        full[diagonal] = 1.0
    for index, value in values.items():
        full[index] = value
    return full


def gps_time():
    seconds = TIME_S - 315964800 + 18
    return int(seconds // 604800), int(round(seconds % 604800 * 1000))


def messages():
    half = SIGMA**2 / 2
    old = math.sqrt(SIGMA**3 / 2)
    yield "odometry_ardupilot_4_7", odometry(ardupilot_ne(), covariance({0: half, 6: half}), mav.MAV_FRAME_LOCAL_FRD)
    yield "odometry_ardupilot_4_6", odometry(ardupilot_ne(), covariance({0: old, 6: old}), mav.MAV_FRAME_LOCAL_FRD)
    yield "odometry_px4_1_17", odometry(px4_ne(), covariance({0: NN, 1: EN, 6: EE, 11: 25.0}), mav.MAV_FRAME_LOCAL_NED)
    e7 = (round(LAT * 1e7), round(LON * 1e7))
    yield "global_position_sensor", mav.MAVLink_global_position_sensor_message(**{
        "target_system": 7, "target_component": 1, "id": 1, "time_usec": int(TIME_S * 1e6), "processing_time": 0,
        "source": mav.GLOBAL_POSITION_SRC_VISION, "flags": 0, "lat": e7[0], "lon": e7[1], "alt": AMSL,
        "alt_ellipsoid": NAN, "eph": SIGMA, "epv": NAN})
    yield "position_estimate", mav.MAVLink_command_int_message(
        7, 1, mav.MAV_FRAME_GLOBAL, mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0, 0,
        TIME_S % 250, 0.0, SIGMA, 0.0, e7[0], e7[1], NAN)
    week, ms = gps_time()
    yield "gps_input", mav.MAVLink_gps_input_message(
        int(TIME_S * 1e6), 2, mav.GPS_INPUT_IGNORE_FLAG_VEL_VERT | mav.GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY, ms, week, 3,
        e7[0], e7[1], AMSL, SIGMA / 5, SIGMA / 5, V_NORTH, V_EAST, 0.0, V_SIGMA, SIGMA, 5.0, 10, 0)


def write_mavlink():
    link = mav.MAVLink(None, srcSystem=7, srcComponent=197)
    with open(HERE / "mavlink.txt", "w") as file:
        for name, message in messages():
            link.seq = 5
            file.write(f"{name} {message.pack(link).hex()}\n")


def degrees_minutes(value, width):
    units = round(abs(value) * 60 * 1e5)
    return f"{units // 6000000:0{width}d}{units % 6000000 / 1e5:08.5f}"


def write_nmea():
    cases = [("tracking", LAT, LON, 1, "A", AMSL), ("coasting", -33.99999999, -0.5, 6, "E", None)]
    with open(HERE / "nmea.txt", "w") as file:
        for name, lat, lon, quality, mode, amsl in cases:
            place = (degrees_minutes(lat, 2), "N" if lat >= 0 else "S", degrees_minutes(lon, 3), "E" if lon >= 0 else "W")
            gga = pynmea2.GGA("GP", "GGA", (
                "141320.25", *place, str(quality), "10", f"{SIGMA / 5:.1f}", "" if amsl is None else f"{amsl:.1f}",
                "M", "", "M", "", ""))
            course = math.degrees(math.atan2(V_EAST, V_NORTH)) % 360
            rmc = pynmea2.RMC("GP", "RMC", (
                "141320.25", "A", *place, f"{math.hypot(V_EAST, V_NORTH) * 3600 / 1852:.2f}", f"{course:.1f}", "210926",
                "", "", mode))
            for sentence in (gga, rmc):
                parsed = pynmea2.parse(sentence.render(), check=True)
                assert abs(parsed.latitude - lat) < 1e-6 and abs(parsed.longitude - lon) < 1e-6
                file.write(f"{name} {sentence.render()}\n")


KLV_NAMES = {
    5: "heading_deg", 6: "pitch_deg", 7: "roll_deg", 15: "altitude_amsl_m", 18: "azimuth_deg", 19: "elevation_deg",
    20: "sensor_roll_deg", 25: "ground_amsl_m", 79: "velocity_north_m_s", 80: "velocity_east_m_s",
}


def write_klv():
    """A packet of MISB ST 0601 with raw integers, and what klvdata reads in it."""
    items = [
        (2, int(TIME_S * 1e6).to_bytes(8, "big")), (5, bytes.fromhex("71c2")), (6, bytes.fromhex("fd3d")),
        (7, bytes.fromhex("08b8")), (15, bytes.fromhex("1c21")), (18, bytes.fromhex("0a4a0a20")),
        (19, bytes.fromhex("c7f84b86")), (20, bytes.fromhex("7dc58ce4")), (25, bytes.fromhex("1a03")),
        (79, bytes.fromhex("09fb")), (80, bytes.fromhex("fa04")), (65, bytes([13])),
    ]
    body = b"".join(bytes([tag, len(value)]) + value for tag, value in items) + bytes([1, 2])
    packet = bytes.fromhex("060e2b34020b01010e01030101000000") + bytes([0x81, len(body) + 2]) + body
    total = sum(byte << (8 * (1 - at % 2)) for at, byte in enumerate(packet)) & 0xFFFF
    packet += total.to_bytes(2, "big")
    (read,) = klvdata.StreamParser(packet)
    with open(HERE / "klv.txt", "w") as file:
        file.write(packet.hex() + "\n")
        for element in read.items.values():
            tag = int.from_bytes(element.key, "big")
            if tag == 2:
                file.write(f"time_s {element.value.value.timestamp()}\n")
            elif tag in KLV_NAMES and hasattr(element.value, "value"):
                file.write(f"{KLV_NAMES[tag]} {element.value.value}\n")


write_mavlink()
write_nmea()
write_klv()
