#!/usr/bin/env python3
"""Publishes the lines of `grim track` as ROS 2 messages:

    grim track --pack town.grim incoming/ --follow --format jsonl | python3 publish.py --origin 24.26,120.72

Topics: `grimnet/fix` (sensor_msgs/NavSatFix, every line; without a fix where the position is not the aircraft's), `grimnet/pose`
(geometry_msgs/PoseWithCovarianceStamped, lines whose position is the aircraft's). Needs rclpy and the message packages of a ROS 2 installation.
"""

import argparse
import json
import math
import sys

import grimnet_ros2


def origin(text):
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (2, 3):
        raise argparse.ArgumentTypeError("expected LAT,LON or LAT,LON,ALTITUDE_M")
    if not (abs(values[0]) <= 90 and abs(values[1]) <= 180 and all(map(math.isfinite, values))):
        raise argparse.ArgumentTypeError(f"{text}: expected a latitude of -90 to 90 and a longitude of -180 to 180 degrees")
    return values


def with_values(arguments):
    """`--origin -24.26,120.72` as `--origin=-24.26,120.72`, because argparse takes a value with a leading minus for an option."""
    joined = []
    for argument in arguments:
        if joined and joined[-1] == "--origin":
            joined[-1] += "=" + argument
        else:
            joined.append(argument)
    return joined


def messages(lines, origin, geoid_height_m=None):
    """For each line the values of a NavSatFix, and of a pose or `None`."""
    for text in lines:
        line = json.loads(text)
        pose = grimnet_ros2.pose_with_covariance_stamped(line, origin)
        yield grimnet_ros2.nav_sat_fix(line, geoid_height_m=geoid_height_m), pose


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--origin", type=origin, required=True, metavar="LAT,LON[,ALTITUDE_M]", help="origin of the frame `map`")
    parser.add_argument("--geoid-height", type=float, metavar="M", help="height of the geoid above the WGS 84 ellipsoid here")
    arguments = parser.parse_args(with_values(sys.argv[1:]))

    try:
        import rclpy
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from sensor_msgs.msg import NavSatFix
    except ImportError as error:
        sys.exit(f"publish.py: {error}; source the setup.bash of a ROS 2 installation, and use its python3")

    rclpy.init()
    node = rclpy.create_node("grimnet")
    fixes = node.create_publisher(NavSatFix, "grimnet/fix", 10)
    poses = node.create_publisher(PoseWithCovarianceStamped, "grimnet/pose", 10)
    try:
        for fix, pose in messages(sys.stdin, arguments.origin, arguments.geoid_height):
            fixes.publish(grimnet_ros2.fill(NavSatFix(), fix))
            if pose is not None:
                poses.publish(grimnet_ros2.fill(PoseWithCovarianceStamped(), pose))
    except KeyboardInterrupt:
        pass
    except json.JSONDecodeError:
        sys.exit("publish.py: standard input is not JSON lines; give `grim track` the option --format jsonl")
    finally:
        node.destroy_node()
        # Ctrl-C has shut it down already.
        if rclpy.ok():
            rclpy.shutdown()


if __name__ == "__main__":
    main()
