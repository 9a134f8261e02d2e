#!/usr/bin/env python3
"""Records flight.jsonl: the flight of `grim demo`, with velocities of a made-up autopilot, as `grim track --record` writes it.

Usage: make_flight.py GRIM, where GRIM is the program. The track that the filter makes of it is in flight_track.jsonl, which
../golden_flight.rs writes.
"""
import csv
import json
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).parent
GRIM = pathlib.Path(sys.argv[1]).resolve()
FIRST_S, STEP_S = 1782036000.0, 1.0
# Frames whose photos are cut off: no fix comes from them.
CUT = range(17, 24)
METRES_PER_DEG = 111_320.0

with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    subprocess.run([GRIM, "demo", "--photos", "1", "--out", "demo"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    with open(folder / "demo/flight_truth.csv") as file:
        places = [(float(row["gps_lon"]) * METRES_PER_DEG, float(row["gps_lat"]) * METRES_PER_DEG) for row in csv.DictReader(file)]
    with open(folder / "autopilot.csv", "w") as file:
        file.write("time,velocity_east_m_s,velocity_north_m_s,velocity_sigma_m_s\n")
        # The autopilot's velocity drifts, and stops for a while.
        for step in range(len(places) - 1):
            if 19 <= step < 22:
                continue
            (e0, n0), (e1, n1) = places[step:step + 2]
            drift = 0.3 * math.sin(step / 7)
            time_s = FIRST_S + STEP_S * (step + 0.5)
            file.write(f"{time_s:.2f},{(e1 - e0) / STEP_S + drift:.3f},{(n1 - n0) / STEP_S - drift:.3f},0.3\n")
    shutil.copytree(folder / "demo/flight", folder / "flight")
    for number in CUT:
        photo = folder / f"flight/frame_{number:03}.jpg"
        photo.write_bytes(photo.read_bytes()[:1000])
    done = subprocess.run([GRIM, "track", "--pack", "demo/area.grim", "flight", "--telemetry", "autopilot.csv", "--record", "recorded",
                           "--out", "track.jsonl"], cwd=folder)
    assert done.returncode == 1, "some frames cannot be used"
    shutil.copy(folder / "recorded/flight.jsonl", HERE / "flight.jsonl")

entries = [json.loads(line) for line in open(HERE / "flight.jsonl")]
frames = [entry["frame"] for entry in entries if "frame" in entry]
states = [frame["answer"]["state"] for frame in frames]
print(len(entries), "lines,", len(frames), "frames:", {state: states.count(state) for state in sorted(set(states))})
