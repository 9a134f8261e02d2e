#!/bin/sh
# Makes flight.mp4, the first ten frames of the flight of `grim demo` as a video: make_video.sh DEMO_FOLDER (needs Debian's ffmpeg).
set -eu
ffmpeg -v error -y -bitexact -framerate 1 -start_number 1 -i "$1/flight/frame_%03d.jpg" -frames:v 10 \
    -vf "hqdn3d=3:3:0:0,scale=400:-2:out_color_matrix=bt709:out_range=tv,format=yuv420p" \
    -c:v libx264 -preset veryslow -crf 38 -g 6 -bf 2 -colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv \
    -movflags +faststart -fflags +bitexact -flags:v +bitexact "$(dirname "$0")/flight.mp4"
