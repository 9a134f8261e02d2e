"""Keypoints, descriptors and matches of OpenCV's SIFT on a synthetic pair of pictures.

Run in this folder with numpy and opencv-python (4.10 or later); writes pair_a.png, pair_b.png, keypoints_{a,b}.csv, descriptors_{a,b}.bin and matches.csv.
The second picture is the first, turned by 35 degrees and reduced to 0.8 about the centre, with other light and noise.
"""

import cv2
import numpy as np

SIDE = 224
rng = np.random.default_rng(2004)


def scene():
    picture = np.full((SIDE, SIDE), 110, np.float32)
    for _ in range(90):
        x, y = rng.uniform(0, SIDE, 2)
        w, h = rng.uniform(4, 26, 2)
        box = cv2.boxPoints(((x, y), (w, h), rng.uniform(0, 90)))
        cv2.fillConvexPoly(picture, np.round(box).astype(np.int32), float(rng.uniform(20, 235)))
    texture = cv2.GaussianBlur(rng.normal(0, 60, picture.shape).astype(np.float32), (0, 0), 2.5)
    return cv2.GaussianBlur(picture, (0, 0), 0.8) + texture


def grey(picture):
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


first = scene()
centre = ((SIDE - 1) / 2, (SIDE - 1) / 2)
turn = cv2.getRotationMatrix2D(centre, 35, 0.8)
second = cv2.warpAffine(first, turn, (SIDE, SIDE), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT_101)
second = second * 0.85 + 20 + rng.normal(0, 2, second.shape)
pictures = {"a": grey(first), "b": grey(second)}
sift = cv2.SIFT_create(enable_precise_upscale=True)
found = {}
for name, picture in pictures.items():
    cv2.imwrite(f"pair_{name}.png", picture)
    keypoints, descriptors = sift.detectAndCompute(picture, None)
    found[name] = (keypoints, descriptors)
    with open(f"keypoints_{name}.csv", "w") as out:
        out.write("x_px,y_px,sigma_px,angle_deg,response\n")
        for k in keypoints:
            out.write(f"{k.pt[0]:.4f},{k.pt[1]:.4f},{k.size / 2:.4f},{k.angle:.3f},{k.response:.6f}\n")
    descriptors.astype(np.uint8).tofile(f"descriptors_{name}.bin")
(ka, da), (kb, db) = found["a"], found["b"]
matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(da, db, k=2)
kept = [m for m, n in matches if m.distance < 0.8 * n.distance]
right = 0
with open("matches.csv", "w") as out:
    out.write("ax_px,ay_px,bx_px,by_px\n")
    for m in kept:
        a, b = ka[m.queryIdx].pt, kb[m.trainIdx].pt
        right += np.hypot(*(turn @ np.array([*a, 1.0]) - b)) < 2
        out.write(f"{a[0]:.3f},{a[1]:.3f},{b[0]:.3f},{b[1]:.3f}\n")
print(cv2.__version__, len(ka), len(kb), len(kept), "of which right", right)
