"""Writes interlaced.png: the passes of Adam7 by hand, as Pillow writes none.

python make_interlaced.py
"""

import struct
import zlib

WIDTH, HEIGHT = 11, 7
# First column and row, and steps between them: PNG, third edition, section 8.2.
PASSES = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
          (0, 1, 1, 2)]

rows = b""
for left, top, across, down in PASSES:
    for y in range(top, HEIGHT, down):
        row = b"".join(bytes([x * 20, y * 30, x * y]) for x in range(left, WIDTH, across))
        rows += b"\0" + row if row else b""


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


with open("interlaced.png", "wb") as file:
    file.write(b"\x89PNG\r\n\x1a\n")
    file.write(chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 1)))
    file.write(chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))
