"""Writes the OpenEXR files of this folder with the OpenEXR library itself.

pip install OpenEXR==3.5.3 numpy==2.4.6 && python make.py
"""

import numpy as np
import OpenEXR as exr

WIDTH, HEIGHT = 16, 9


def pattern(channel, kind=np.float16, width=WIDTH, height=HEIGHT):
    """Multiples of 1/16 below 4, which half floats hold exactly."""
    y, x = np.mgrid[0:height, 0:width]
    return ((x * 7 + y * 13 + channel * 5) % 64 / 16).astype(kind)


def ramp(channel):
    """What PIZ makes smaller, in a size that does so; exact in half floats, too."""
    y, x = np.mgrid[0:24, 0:40]
    return ((x + y * 2 + channel * 3) / 16).astype(np.float16)


def smooth(channel):
    """What lossy compressions are made for."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    return (0.2 + channel / 4 + x / 40 + y * y / 300).astype(np.float16)


def colours(make=pattern, names="RGBA", prefix="", **options):
    return {prefix + name: make("RGBA".index(name), **options) for name in names}


def write(name, channels, compression=exr.ZIP_COMPRESSION, **header):
    header = {"compression": compression, "type": exr.scanlineimage} | header
    with exr.File(header, channels) as file:
        file.write(f"{name}.exr")


LOSSLESS = ["NO", "RLE", "ZIPS", "ZIP", "PXR24"]
LOSSY = ["B44", "B44A", "DWAA", "DWAB"]
NOT_READ = ["HTJ2K32", "HTJ2K256", "LJ2K", "ZSTD"]
for codec in LOSSLESS + NOT_READ:
    write(codec.lower(), colours(), getattr(exr, f"{codec}_COMPRESSION"))
write("piz", colours(ramp), exr.PIZ_COMPRESSION)
for codec in LOSSY:
    write(codec.lower(), colours(smooth), getattr(exr, f"{codec}_COMPRESSION"))
    # What the library itself reads back.
    with exr.File(f"{codec.lower()}.exr", separate_channels=True) as file:
        pixels = {name: channel.pixels for name, channel in file.channels().items()}
    write(f"{codec.lower()}.decoded", pixels)

# More digits than half floats have.
write("float", {name: values + np.float32(2**-18) for name, values in
                colours(kind=np.float32).items()})
# More than 16 bits, which halves don't hold; f32 does.
write("uint", {name: (values * 16).astype(np.uint32) + 100_000 for name, values in
               colours(names="RGB").items()})
write("mixed", {"R": pattern(0), "G": pattern(1, np.float32), "B": pattern(2),
                "A": pattern(3, np.float32), "Z": pattern(9, np.float32)})
write("rgb", colours(names="RGB"))
write("grey", {"Y": pattern(0), "A": pattern(3)})
write("layered", colours(prefix="beauty.") | colours(make=lambda c: pattern(c + 10), prefix="z."))
write("unnamed_first", colours() | colours(make=lambda c: pattern(c + 10), prefix="a."))
write("normals", {"X": pattern(0), "Y": pattern(1), "Z": pattern(2)})
write("window", colours(),
      dataWindow=((-3, -2), (WIDTH - 4, HEIGHT - 3)), displayWindow=((0, 0), (31, 31)))
write("downwards", colours(), exr.ZIPS_COMPRESSION, lineOrder=exr.DECREASING_Y)
tiles = exr.TileDescription()
tiles.xSize, tiles.ySize, tiles.mode = 8, 4, exr.ONE_LEVEL
write("tiled", colours(), type=exr.tiledimage, tiles=tiles)
tiles.mode = exr.MIPMAP_LEVELS
write("mip", colours(), type=exr.tiledimage, tiles=tiles)
tiles.xSize, tiles.ySize, tiles.mode = 32, 24, exr.ONE_LEVEL
write("tiled_piz", colours(ramp, names="RGB"), exr.PIZ_COMPRESSION, type=exr.tiledimage, tiles=tiles)

parts = [("depth", {"Z": pattern(9, np.float32)}), ("beauty", colours()),
         ("color.variance", colours(kind=np.float32)), ("mask", {"Y": pattern(7)})]
header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage, "karat": "facts"}
with exr.File([exr.Part(dict(header), channels, name) for name, channels in parts]) as file:
    file.write("parts.exr")

deep = np.empty((2, 3), dtype=object)
for place in np.ndindex(deep.shape):
    deep[place] = np.array([1.0, 2.0], dtype=np.float32)
write("deep", {name: deep for name in "RGBA"}, exr.ZIPS_COMPRESSION, type=exr.deepscanline)
