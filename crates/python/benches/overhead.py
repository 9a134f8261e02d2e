"""What Python adds to the time of the library for a photo: python3 overhead.py AREA.grim PHOTO.jpg [ROUNDS]

The library states the time of its search in `time_ms["total"]`; what it does not state, decoding, is measured with
`read_photo` at the size that a search needs, less its copy into an array, which cannot be larger than measured here. Medians.
"""

import statistics
import sys
import time

import grimnet
import numpy as np


def timed_ms(work):
    begin = time.perf_counter()
    result = work()
    return (time.perf_counter() - begin) * 1e3, result


def main():
    localizer = grimnet.Localizer(sys.argv[1])
    path = sys.argv[2]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 40
    with open(path, "rb") as file:
        data = file.read()
    array = grimnet.read_photo(path)
    columns_first = np.asfortranarray(array)
    height, width, _ = array.shape
    inputs = {
        "bytes of a JPEG": (data, True),
        f"array {width} x {height}, contiguous": (array, False),
        f"array {width} x {height}, other strides": (array[:, :, ::-1], False),
        f"array {width} x {height}, columns first": (columns_first, False),
    }
    localizer.locate(path)
    for name, (photo, is_decoded) in inputs.items():
        over_ms, total_ms = [], []
        for _ in range(rounds):
            decoding_ms = timed_ms(lambda: grimnet.read_photo(data, max_side_px=2048))[0] if is_decoded else 0.0
            took_ms, answer = timed_ms(lambda: localizer.locate(photo, heading=0.0, gsd_m=0.12))
            total_ms.append(answer.time_ms["total"])
            over_ms.append(took_ms - answer.time_ms["total"] - decoding_ms)
        print(f"{name}: {statistics.median(over_ms):.2f} ms over the library's {statistics.median(total_ms):.1f} ms")
    answer = localizer.locate(path)
    for name, work in {"to_dict": answer.to_dict, "covariance_en_m2": lambda: answer.covariance_en_m2}.items():
        print(f"{name}: {statistics.median(timed_ms(work)[0] for _ in range(200)) * 1e3:.0f} microseconds")


if __name__ == "__main__":
    main()
