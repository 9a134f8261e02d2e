#!/bin/sh
# Makes the videos whose pixels are not square, grey, and their third frame with square pixels as ffmpeg makes it (version 9 with x264
# and x265).
set -eu
cd "$(dirname "$0")"
make() {
    name=$1 size=$2 aspect=$3
    shift 3
    ffmpeg -v error -y -f lavfi -i "testsrc2=size=$size:rate=15" -frames:v 5 -vf "hue=s=0,setsar=$aspect,format=yuv420p" "$@" -g 5 \
        -fflags +bitexact -flags:v +bitexact "$name.mp4"
    ffmpeg -v error -y -i "$name.mp4" -vf "select=eq(n\,2),scale='iw*clip(sar,1,4)':'ih*clip(1/sar,1,4)':flags=bilinear+accurate_rnd+full_chroma_int,format=rgb24,setsar=1" \
        -frames:v 1 -pix_fmt rgb24 -bitexact "$name.png"
}
# The stream states two numbers (`aspect_ratio_idc` 255).
make h264_7_5 80x64 7/5 -c:v libx264 -crf 30
# The stream states a number of the standard's table.
make h265_10_11 64x80 10/11 -c:v libx265 -tag:v hvc1 -crf 32 -x265-params "log-level=error:pools=1:frame-threads=1:info=0"
