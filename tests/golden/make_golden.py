"""Makes the small files beside it with tifffile, Pillow, NumPy, SciPy and safetensors, for the unit tests to read without
Python.

Every image is 7 x 5 (rows x columns). Grey pixels hold row * 5 + column + 1, scaled by 1 (8 bits), 257 (16 bits) or
1/64 (floats); channel c adds 40 * c, page p adds 3 * p (before scaling).
"""
from pathlib import Path

import numpy as np
import scipy.io
import tifffile
from PIL import Image
from safetensors.numpy import save_file

HERE = Path(__file__).parent


def image(kind="u1", channels=1, page=0):
    grey = np.arange(1, 36).reshape(7, 5) + 3 * page
    planes = np.stack([grey + 40 * c for c in range(channels)])
    factor = {"u1": 1, "u2": 257, "u4": 16777216 // 2, "i2": 128, "f2": 1 / 64, "f4": 1 / 64, "f8": 1 / 64}[kind]
    return (planes * factor).astype(kind)


def interleaved(kind, channels):
    return np.ascontiguousarray(np.moveaxis(image(kind, channels), 0, -1))


def write(name, data, **options):
    options.setdefault("metadata", None)
    tifffile.imwrite(HERE / name, data, software=False, **options)


for kind in ("u1", "u2", "u4", "i2", "f2", "f4", "f8"):
    write(f"grey_{kind}.tif", image(kind)[0])
    if kind != "u1":
        write(f"grey_{kind}_big_endian.tif", image(kind)[0], byteorder=">")
write("rgb_u1.tif", interleaved("u1", 3), photometric="rgb")
write("rgb_u2_planar.tif", image("u2", 3), photometric="rgb", planarconfig="separate")
write("rgba_u1.tif", np.dstack([interleaved("u1", 3), np.full((7, 5), 200, "u1")]), photometric="rgb", extrasamples=["unassalpha"])
write("grey_u2_white.tif", 65535 - image("u2")[0], photometric="miniswhite")
write("grey_u2_strips.tif", image("u2")[0], rowsperstrip=2)
write("rgb_f4_tiles.tif", interleaved("f4", 3), photometric="rgb", tile=(16, 16), compression="zlib", byteorder=">")
write("grey_u2_lzw.tif", image("u2")[0], compression="lzw", predictor=True)
write("grey_u1_packbits.tif", image("u1")[0], compression="packbits")
write("grey_f4_deflate.tif", image("f4")[0], compression="zlib", predictor=True)
write("grey_u2_zstd.tif", image("u2")[0], compression="zstd")
write("grey_u1_jpegxl.tif", image("u1")[0], compression="jpegxl")
colours = np.zeros((3, 256), "u2")
colours[:, :] = np.arange(256) * 257
colours[1] = (np.arange(256) + 40) % 256 * 257
colours[2] = (np.arange(256) + 80) % 256 * 257
write("palette_u1.tif", image("u1")[0], photometric="palette", colormap=colours)
write("complex.tif", image("f4")[0].astype(np.complex64))

with tifffile.TiffWriter(HERE / "pages_bigtiff.tif", bigtiff=True) as out:
    for page in range(3):
        out.write(image("u2", 1, page)[0], software=False, metadata=None)
with tifffile.TiffWriter(HERE / "pages_thumbnails.tif") as out:
    for page in range(2):
        out.write(image("u1", 1, page)[0], subifds=1, software=False, metadata=None)
        out.write(image("u1", 1, page)[0][::2, ::2], subfiletype=1, software=False, metadata=None)
        out.write(image("u1", 1, page)[0][::3, ::3], subfiletype=1, software=False, metadata=None)

stack = np.stack([image("u2", 2, page) for page in range(3)])  # Z C Y X
for name, more in (("imagej.tif", {}), ("imagej_one_directory.tif", dict(truncate=True))):
    tifffile.imwrite(HERE / name, stack.astype(">u2"), imagej=True, byteorder=">", resolution=(4.0, 4.0), software=False,
                     metadata=dict(axes="ZCYX", spacing=2.5, unit="um"), **more)
tifffile.imwrite(HERE / "ome.tif", np.ascontiguousarray(np.swapaxes(stack, 0, 1)), ome=True, software=False, metadata=dict(
    axes="CZYX", PhysicalSizeX=6.5, PhysicalSizeXUnit="µm", PhysicalSizeZ=0.1, PhysicalSizeZUnit="mm", UUID="urn:uuid:00000000-0000-0000-0000-000000000000"))

# files that are not TIFF
grey, colour = image("u1")[0], interleaved("u1", 3)
Image.fromarray(grey).save(HERE / "grey_u1.png")
Image.fromarray(image("u2")[0]).save(HERE / "grey_u2.png")
Image.fromarray(np.dstack([colour, grey])).save(HERE / "rgba_u1.png")
Image.fromarray(colour).quantize(64, dither=Image.Dither.NONE).save(HERE / "palette_u1.png")
Image.fromarray(grey).save(HERE / "grey_u1.jpg", quality=100)
Image.fromarray(colour).save(HERE / "rgb_u1.jpg", quality=100, subsampling=0)
for kind in ("u1", "u2", "f4", "f8"):
    np.save(HERE / f"grey_{kind}.npy", image(kind)[0])
np.save(HERE / "grey_u2_big_endian.npy", image("u2")[0].astype(">u2"))
np.save(HERE / "rgb_u1.npy", colour)
np.save(HERE / "rgb_u2_planar.npy", image("u2", 3))
np.save(HERE / "rgb_f4_fortran.npy", np.asfortranarray(interleaved("f4", 3)))
np.save(HERE / "frames_f4.npy", np.stack([image("f4", 1, page)[0] for page in range(4)]))
np.save(HERE / "frames_rgb_u1.npy", np.stack([np.moveaxis(image("u1", 3, page), 0, -1) for page in range(2)]))
np.save(HERE / "complex.npy", image("f4")[0].astype(np.complex64))
scipy.io.savemat(HERE / "rgb_f8.mat", {"psf": interleaved("f8", 3), "other": np.eye(2)})
scipy.io.savemat(HERE / "frames_u2.mat", {"stack": np.dstack([image("u2", 1, page)[0] for page in range(4)])}, do_compression=True)
# as a Raspberry Pi's camera writes it: colours B G / G R, black at 64, white at 1023; 24 x 32 pixels count up from 64
write("mosaic.dng", np.arange(64, 64 + 24 * 32, dtype="u2").reshape(24, 32), photometric=32803, subfiletype=0, extratags=[
    (50706, "B", 4, (1, 4, 0, 0), True), (271, "s", 0, "Raspberry Pi", True), (272, "s", 0, "imx477", True),
    (50708, "s", 0, "Raspberry Pi imx477", True), (33421, "H", 2, (2, 2), True), (33422, "B", 4, (2, 1, 1, 0), True),
    (50714, "H", 1, 64, True), (50717, "H", 1, 1023, True), (50778, "H", 1, 21, True),
    (50721, "2i", 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True)])

save_file({"weight": image("f4", 2) * 64, "half": image("f2")[0], "wide": image("f8")[0], "count": np.int64([1, 2, 3])},
          HERE / "tensors.safetensors", metadata={"note": "größe ✓"})
