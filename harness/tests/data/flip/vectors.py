"""FLIP as NVIDIA computes it (flip-evaluator 1.7), for harness/tests/metric.rs.

    pip install flip-evaluator==1.7 numpy==2.4.6 && python vectors.py

Writes a map of 32-bit floats for each case, little-endian, row by row; and a map of bytes, which of
the exposures has the largest error, 255 where there is none. The images are made of integers by
exact operations, so that the test makes the same ones.

The package returns no map of exposures. So each is evaluated alone: the largest errors are then
those of all at once, and the first exposure that has them is what the package's command line
draws.
"""

import math

import numpy as np
from flip_evaluator import evaluate

WIDTH, HEIGHT = 48, 40
# Name, first and last exposure, pixels per degree. The number of exposures is the default: one a
# stop, at least two.
CASES = [
    ("noise", -3.0, 2.0, None),
    ("edges", -6.0, 1.0, None),
    ("highlight", -9.5, -1.5, None),
    ("drift", -1.0, 0.5, None),
    ("near", -4.0, 3.0, 30.0),
    ("far", -2.0, 2.0, 100.0),
]
# LDR-FLIP: name, what is compared, pixels per degree.
DISPLAYED = [
    ("ldr_noise", "noise", None),
    ("ldr_edges", "edges", None),
    ("ldr_far", "far", 100.0),
]


def random(x, y, channel, seed):
    """24 random bits of a pixel, as a number in 0 to 1: exact in 32-bit floats."""
    mask = np.uint64(0xFFFFFFFF)
    h = x.astype(np.uint64) + 48 * y.astype(np.uint64) + 1920 * np.uint64(channel)
    h = (h + np.uint64(7919 * seed)) & mask
    h = (h * np.uint64(747796405) + np.uint64(2891336453)) & mask
    h = (((h >> ((h >> np.uint64(28)) + np.uint64(4))) ^ h) * np.uint64(277803737)) & mask
    h = (h >> np.uint64(22)) ^ h
    return ((h >> np.uint64(8)).astype(np.float32) / np.float32(1 << 24)).astype(np.float32)


def pair(name):
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    golden = np.stack([random(x, y, c, 1) for c in range(3)], axis=-1)
    one = np.float32(1)
    if name == "noise":
        actual = np.stack([random(x, y, c, 2) for c in range(3)], axis=-1)
    elif name == "edges":
        # A bar, and the same bar a pixel further, on a ramp.
        ramp = (x[..., None] * np.array([4, 2, 1])).astype(np.float32) / np.float32(64)
        golden = np.where(((x // 8) % 2 == 0)[..., None], ramp, np.float32(16))
        actual = np.where((((x + 1) // 8) % 2 == 0)[..., None], ramp, np.float32(16))
    elif name == "highlight":
        golden = golden / np.float32(4)
        bright = ((x > 20) & (x < 26) & (y > 10) & (y < 16))[..., None]
        actual = np.where(bright, np.float32(256), golden)
        golden = np.where(bright, np.float32(512), golden)
    elif name == "drift":
        actual = golden * (one + np.float32(1 / 1024))
    else:
        actual = golden * np.where((x < 24)[..., None], one, np.float32(1.125))
    return golden.astype(np.float32), actual.astype(np.float32)


def encoded(linear):
    """sRGB of what a display shows, in 64-bit floats first."""
    linear = np.clip(linear.astype(np.float64), 0, 1)
    low = linear <= 0.0031308
    return np.where(low, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055).astype(np.float32)


def write(name, found):
    errors, mean, used = found
    errors.astype("<f4").tofile(f"{name}.f32")
    print(f"{name:<10} mean {mean:.6f} largest {errors.max():.6f} {used}")


for name, start, stop, ppd in CASES:
    golden, actual = pair(name)
    distance = {} if ppd is None else {"ppd": ppd}
    parameters = {"startExposure": start, "stopExposure": stop, **distance}
    found = evaluate(golden, actual, "HDR", True, False, True, parameters)
    write(name, found)
    largest = np.zeros((HEIGHT, WIDTH), np.float32)
    worst = np.full((HEIGHT, WIDTH), 255, np.uint8)
    count = max(2, math.ceil(stop - start))
    step = np.float32(stop - start) / np.float32(count - 1)
    for index in range(count):
        exposure = float(np.float32(start) + np.float32(index) * step)
        parameters = {"startExposure": exposure, "stopExposure": exposure, **distance}
        one = evaluate(golden, actual, "HDR", True, False, False, parameters)[0]
        one = one.reshape(HEIGHT, WIDTH)
        worst[one > largest] = index
        largest = np.maximum(largest, one)
    assert (largest == found[0].reshape(HEIGHT, WIDTH)).all()
    if name != "drift":  # which is within the gate: nobody asks for its exposures
        worst.tofile(f"{name}.u8")

for name, images, ppd in DISPLAYED:
    golden, actual = (encoded(image) for image in pair(images))
    parameters = {} if ppd is None else {"ppd": ppd}
    write(name, evaluate(golden, actual, "LDR", True, False, True, parameters))
