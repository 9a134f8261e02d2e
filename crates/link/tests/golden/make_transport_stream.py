#!/usr/bin/env python3
"""Writes klv.ts, a video with MISB ST 0601 metadata, and klv_ts.txt, the metadata as ffmpeg and klvdata read them.

ffmpeg makes a transport stream of a test video; metadata packets are put between its packets here, asynchronous ones (stream type 6,
MISB ST 1402) and synchronous ones (0x15), some longer than a transport packet. Each line of klv_ts.txt: seconds from the first frame
by ffprobe, and the bytes of the packet.
Usage (needs Debian's ffmpeg): pip install klvdata==0.0.3; python make_transport_stream.py
"""
import pathlib
import subprocess

import klvdata

HERE = pathlib.Path(__file__).parent
VIDEO = HERE.parents[2] / "video/tests/golden/h264_b_frames.mp4"
KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
TIME_S = 1_790_000_000.25
PMT_PID, ASYNC_PID, SYNC_PID = 0x1000, 0x201, 0x202


def crc(data):
    value = 0xFFFFFFFF
    for byte in data:
        value ^= byte << 24
        for _ in range(8):
            value = (value << 1 ^ 0x04C11DB7 if value & 0x80000000 else value << 1) & 0xFFFFFFFF
    return value.to_bytes(4, "big")


def klv(number, time_s):
    heading = int((10 + number) / 360 * 65535)
    items = [(2, int(time_s * 1e6).to_bytes(8, "big")), (5, heading.to_bytes(2, "big")), (6, bytes(2)), (7, bytes(2)),
             (15, bytes.fromhex("1c21")), (18, bytes(4)), (19, bytes.fromhex("c0000000")), (20, bytes(4)),
             (25, bytes.fromhex("1a03")), (65, bytes([13]))]
    if number % 3 == 0:
        items.insert(1, (3, b"a mission whose name is long" * 8))
    body = b"".join(bytes([tag]) + (bytes([len(value)]) if len(value) < 128 else bytes([0x81, len(value)])) + value
                    for tag, value in items) + bytes([1, 2])
    length = len(body) + 2
    packet = KEY + (bytes([0x81, length]) if length < 256 else b"\x82" + length.to_bytes(2, "big")) + body
    total = sum(byte << (8 * (1 - at % 2)) for at, byte in enumerate(packet)) & 0xFFFF
    return packet + total.to_bytes(2, "big")


def pes(stream_id, ticks, payload):
    pts = bytes([0x21 | ticks >> 29 & 0x0E, ticks >> 22 & 0xFF, 1 | ticks >> 14 & 0xFE, ticks >> 7 & 0xFF, 1 | ticks << 1 & 0xFE])
    header = bytes([0x84, 0x80, 5]) + pts
    return b"\0\0\1" + bytes([stream_id]) + (len(header) + len(payload)).to_bytes(2, "big") + header + payload


def transport(pid, data, counter):
    packets = []
    first = True
    while data:
        part, data = data[:184], data[184:]
        head = bytes([0x47, (0x40 if first else 0) | pid >> 8, pid & 0xFF])
        control = 0x10 | counter[0]
        adaptation = b""
        if len(part) < 184:
            control |= 0x20
            room = 183 - len(part)
            adaptation = bytes([room]) + (b"\0" + b"\xff" * (room - 1) if room else b"")
        packets.append(head + bytes([control]) + adaptation + part)
        counter[0] = (counter[0] + 1) & 0x0F
        first = False
    return packets


def with_metadata(pmt):
    """The table of streams with the two of metadata."""
    start = 5 + pmt[4]
    length = int.from_bytes(pmt[start + 1:start + 3], "big") & 0xFFF
    section = pmt[start:start + 3 + length - 4]
    registration = b"\x05\x04KLVA"
    metadata = b"\x26\x09\x01\x00\xffKLVA\x00\x0f"
    for kind, pid, descriptors in ((6, ASYNC_PID, registration), (0x15, SYNC_PID, metadata)):
        section += bytes([kind, 0xE0 | pid >> 8, pid & 0xFF, 0xF0, len(descriptors)]) + descriptors
    section = section[:1] + (0xB000 | len(section) - 3 + 4).to_bytes(2, "big") + section[3:]
    section += crc(section)
    return (pmt[:start] + section).ljust(188, b"\xff")[:188]


def pts_of(packet):
    """The time of a packet that begins a video frame, ticks."""
    start = 4 + (1 + packet[4] if packet[3] & 0x20 else 0)
    if not packet[1] & 0x40 or packet[start:start + 3] != b"\0\0\1" or not 0xE0 <= packet[start + 3] <= 0xEF:
        return None
    b = packet[start + 9:start + 14]
    return (b[0] >> 1 & 7) << 30 | b[1] << 22 | (b[2] >> 1) << 15 | b[3] << 7 | b[4] >> 1


def probe(stream):
    entries = "packet=pts_time"
    text = subprocess.run(["ffprobe", "-v", "error", "-select_streams", stream, "-show_entries", entries, "-of", "csv=p=0",
                           HERE / "klv.ts"], check=True, capture_output=True, text=True).stdout
    return [float(line.strip(",")) for line in text.split()]


def extracted(stream):
    return subprocess.run(["ffmpeg", "-v", "error", "-i", HERE / "klv.ts", "-map", stream, "-c", "copy", "-f", "data", "-"],
                          check=True, capture_output=True).stdout


plain = subprocess.run(["ffmpeg", "-v", "error", "-i", VIDEO, "-c", "copy", "-flags:v", "+bitexact", "-fflags", "+bitexact",
                        "-pat_period", "0.5", "-f", "mpegts", "-"], check=True, capture_output=True).stdout
stream, counters, sequence = [], {ASYNC_PID: [0], SYNC_PID: [0]}, []
frames, first = 0, None
for at in range(0, len(plain), 188):
    packet = plain[at:at + 188]
    pid = (packet[1] & 0x1F) << 8 | packet[2]
    ticks = pts_of(packet)
    if ticks is not None:
        first = first or ticks
        if frames % 5 == 0:
            data = klv(frames, TIME_S + (ticks - first) / 90_000)
            stream += transport(ASYNC_PID, pes(0xBD, ticks, data), counters[ASYNC_PID])
            sequence.append((ASYNC_PID, data))
        if frames % 10 == 0:
            data = klv(frames, TIME_S + (ticks - first) / 90_000)
            unit = bytes([0, 0, 0xDF]) + len(data).to_bytes(2, "big") + data
            stream += transport(SYNC_PID, pes(0xFC, ticks, unit), counters[SYNC_PID])
            sequence.append((SYNC_PID, data))
        frames += 1
    stream.append(with_metadata(packet) if pid == PMT_PID else packet)
(HERE / "klv.ts").write_bytes(b"".join(stream))

start_s = min(probe("v:0"))
lines = {}
for index, pid in enumerate((ASYNC_PID, SYNC_PID)):
    times, data = probe(f"d:{index}"), extracted(f"0:d:{index}")
    packets = [packet for other, packet in sequence if other == pid]
    assert len(times) == len(packets), (times, len(packets))
    for time_s, packet in zip(times, packets):
        assert packet in data, "ffmpeg reads other bytes"
        (read,) = klvdata.StreamParser(packet)
        assert abs(read.items[b"\x02"].value.value.timestamp() - TIME_S - (time_s - start_s)) < 1e-4
        lines[pid, packet] = f"{time_s - start_s:.6f} {packet.hex()}\n"
(HERE / "klv_ts.txt").write_text("".join(lines[one] for one in sequence))
print(len(stream) * 188, "bytes")
