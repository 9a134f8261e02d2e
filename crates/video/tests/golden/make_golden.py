#!/usr/bin/env python3
"""Makes the test videos and what ffmpeg decodes them to (needs Debian's ffmpeg, 5.1; x264 and x265 are in it).

For each video NAME: NAME.txt has a line `pts_s sha256` for each frame that ffmpeg shows, where the hash is that of the decoded planes
(8 bit: one byte a sample; 10 bit: two, little endian), and NAME.png the frame in the middle as RGB, upright, by swscale.
"""
import pathlib
import subprocess

HERE = pathlib.Path(__file__).parent
X264 = ["-c:v", "libx264", "-preset", "slow", "-crf", "30"]
X265 = ["-c:v", "libx265", "-preset", "medium", "-crf", "32"]
TAGS_709 = ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]
TAGS_601 = ["-colorspace", "smpte170m", "-color_primaries", "smpte170m", "-color_trc", "smpte170m"]
# Without it ffmpeg shows columns at the left that are not to be shown.
EXACT = ["-flags", "unaligned"]
SOURCE = ["-f", "lavfi", "-i", "testsrc2=size=176x112:rate=15:duration=2"]


def ffmpeg(*arguments):
    subprocess.run(["ffmpeg", "-hide_banner", "-loglevel", "error", "-y", "-bitexact", *map(str, arguments)], check=True)


def encode(name, *arguments, filters="null"):
    ffmpeg(*SOURCE, "-vf", filters, *arguments, "-fflags", "+bitexact", "-flags:v", "+bitexact", HERE / name)


def golden(name):
    path = HERE / name
    times = subprocess.run(
        ["ffprobe", "-v", "error", "-select_streams", "v:0", "-show_entries", "frame=pts_time", "-of", "csv=p=0", path],
        check=True, capture_output=True, text=True).stdout.split()
    times = [time.strip(",") for time in times]
    hashes = subprocess.run(
        ["ffmpeg", "-loglevel", "error", "-noautorotate", *EXACT, "-i", path, "-vsync", "passthrough", "-f", "framehash", "-hash", "sha256", "-"],
        check=True, capture_output=True, text=True).stdout.splitlines()
    hashes = [line.split(",")[-1].strip() for line in hashes if not line.startswith("#")]
    assert len(times) == len(hashes), (name, len(times), len(hashes))
    text = "".join(f"{time} {digest}\n" for time, digest in zip(times, hashes))
    path.with_suffix(".txt").write_text(text)
    ffmpeg(*EXACT, "-i", path, "-vf", f"select=eq(n\\,{len(times) // 2}),scale=flags=neighbor+accurate_rnd+full_chroma_int",
           "-frames:v", 1, "-pix_fmt", "rgb24", path.with_suffix(".png"))
    print(name, path.stat().st_size, "bytes,", len(times), "frames")


# B-frames that others are predicted from, groups of 12 frames; BT.709.
encode("h264_b_frames.mp4", *X264, "-profile:v", "high", "-pix_fmt", "yuv420p", "-g", 12, "-bf", 3,
       "-x264-params", "b-pyramid=normal:colorprim=bt709:transfer=bt709:colormatrix=bt709", "-metadata",
       "creation_time=2026-05-01T12:00:00Z", filters="scale=out_color_matrix=bt709,format=yuv420p")
# CAVLC, four slices a frame, QuickTime, full range, BT.601.
encode("h264_slices_full_range.mov", *X264, "-profile:v", "baseline", "-g", 10, "-x264-params", "slices=4:fullrange=on",
       *TAGS_601, "-color_range", "pc", filters="scale=out_range=full:out_color_matrix=bt601,format=yuv420p")
# Groups of pictures whose first frames in the order of showing are predicted from the group before (CRA, RASL).
encode("h265_open_groups.mp4", *X265, "-pix_fmt", "yuv420p", "-tag:v", "hvc1",
       "-x265-params", "keyint=10:min-keyint=10:bframes=4:open-gop=1:log-level=error:pools=1:frame-threads=1:info=0")
# Ten bits, BT.709.
encode("h265_10_bit.mp4", *X265, "-pix_fmt", "yuv420p10le", "-tag:v", "hvc1", *TAGS_709,
       "-x265-params", "keyint=15:bframes=3:log-level=error:pools=1:frame-threads=1:info=0",
       filters="scale=out_color_matrix=bt709,format=yuv420p10le")
# Fragments.
encode("h264_fragments.mp4", *X264, "-pix_fmt", "yuv420p", "-g", 10, "-bf", 2, "-movflags",
       "frag_keyframe+empty_moov+default_base_moof")
# Cropped on all sides: 168 x 100 of 176 x 112.
encode("h264_cropped.mp4", *X264, "-pix_fmt", "yuv420p", "-g", 30, "-bf", 2,
       "-bsf:v", "h264_metadata=crop_left=2:crop_top=4:crop_right=6:crop_bottom=8")
# Turned by the container.
encode("whole.mp4", *X264, "-pix_fmt", "yuv420p", "-g", 30, "-bf", 2)
ffmpeg("-i", HERE / "whole.mp4", "-c", "copy", "-metadata:s:v", "rotate=90", HERE / "h264_rotated.mp4")
# Cut out of a longer one: an edit list leaves out what only others need.
ffmpeg("-ss", "0.55", "-i", HERE / "whole.mp4", "-c", "copy", HERE / "h264_edit_list.mp4")
(HERE / "whole.mp4").unlink()

for video in sorted([*HERE.glob("*.mp4"), *HERE.glob("*.mov")]):
    golden(video.name)
