"""Files by tifffile read here, files written here read by tifffile. Usage: oracle_tiff.py ORACLE_IO"""
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as xml
from pathlib import Path

try:
    import numpy as np
    import tifffile
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

try:  # tifffile's codecs beyond deflate
    import imagecodecs
except ImportError:
    imagecodecs = None

TOOL = sys.argv[1]
TEMPORARY = tempfile.TemporaryDirectory(prefix="hadalens-tiff-")
FOLDER = Path(TEMPORARY.name)
RANDOM = np.random.default_rng(1)


def read(path):
    done = subprocess.run([TOOL, "read-tiff", path, FOLDER / "out.raw"], capture_output=True, text=True)
    if done.returncode:
        raise AssertionError(f"{path}: {done.stderr}")
    numbers = done.stdout.split()
    frames, channels, rows, cols, slices, times = map(int, numbers[:6])
    data = np.fromfile(FOLDER / "out.raw", np.float32).reshape(frames, channels, rows, cols)
    return data, slices, times, float(numbers[7]), float(numbers[8])


def values(shape, kind):
    kind = np.dtype(kind)
    if kind.kind == "f":
        return RANDOM.standard_normal(shape).astype(kind)
    limits = np.iinfo(kind)
    return RANDOM.integers(limits.min, limits.max, shape, kind, endpoint=True)


def as_float(data):
    if data.dtype.kind == "f":
        return data.astype(np.float32)
    return (data.astype(np.float64) / np.iinfo(data.dtype).max).astype(np.float32)


def check(name, path, expected, **more):
    data, slices, times, pixel, spacing = read(path)
    assert data.shape == expected.shape, (name, data.shape, expected.shape)
    assert np.array_equal(data, expected, equal_nan=True) or np.abs(data - expected).max() < 1e-6, name
    for key, value in dict(slices=slices, times=times, pixel=pixel, spacing=spacing).items():
        assert key not in more or abs(more[key] - value) < 1e-5 * abs(more[key]), (name, key, value, more[key])


def plain_files():
    """Types, byte orders, layouts and codecs."""
    count = 0
    codecs = [None, "zlib", "lzw", "packbits", "zstd", "lzma", "lerc"] if imagecodecs else [None, "zlib"]
    for kind in "u1 u2 u4 i1 i2 i4 f2 f4 f8".split():
        for order in "<>":
            for codec in codecs:
                for tile in (None, (16, 32)):
                    for layout in ("grey", "rgb", "rgba", "planar"):
                        if codec == "lerc" and (kind == "f2" or layout != "grey"):
                            continue
                        shape = {"grey": (37, 53), "rgb": (37, 53, 3), "rgba": (37, 53, 4), "planar": (3, 37, 53)}[layout]
                        data = values(shape, kind)
                        predictor = imagecodecs is not None and codec in ("zlib", "lzw") and layout != "planar" and kind != "f2"
                        path = FOLDER / "plain.tif"
                        options = {}
                        if layout != "grey":
                            options["photometric"] = "rgb"
                            options["planarconfig"] = "separate" if layout == "planar" else "contig"
                        if layout == "rgba":
                            options["extrasamples"] = ["unassalpha"]
                        try:
                            tifffile.imwrite(path, data, byteorder=order, compression=codec, predictor=predictor, tile=tile,
                                             rowsperstrip=None if tile else 9, metadata=None, **options)
                        except (ValueError, NotImplementedError, RuntimeError, ImportError):
                            continue
                        expected = as_float(data)
                        if layout in ("rgb", "rgba"):
                            expected = np.moveaxis(expected, -1, 0)[:3]
                        check((kind, order, codec, tile, layout), path, expected.reshape((1, -1, 37, 53)))
                        count += 1
    assert count > (500 if imagecodecs else 200), count
    return count


def stacks():
    data = values((2, 5, 3, 37, 53), "u2")  # T Z C Y X
    flat = as_float(data).reshape(10, 3, 37, 53)
    for order in "<>":
        for kwargs in (dict(), dict(truncate=True)):
            path = FOLDER / "imagej.tif"
            tifffile.imwrite(path, data.astype(data.dtype.newbyteorder(order)), imagej=True, byteorder=order, resolution=(4.0, 4.0),
                             metadata=dict(axes="TZCYX", spacing=2.5, unit="um"), **kwargs)
            check(("imagej", order, kwargs), path, flat, slices=5, times=2, pixel=0.25, spacing=2.5)
    for axes in ("TZCYX", "CTZYX", "ZTCYX", "TCZYX"):
        path = FOLDER / "stack.ome.tif"
        moved = np.transpose(data, ["TZCYX".index(a) for a in axes])
        tifffile.imwrite(path, moved, ome=True, metadata=dict(axes=axes, PhysicalSizeX=6.5, PhysicalSizeXUnit="µm", PhysicalSizeZ=0.1,
                                                              PhysicalSizeZUnit="mm"))
        check(("ome", axes), path, flat, slices=5, times=2, pixel=6.5, spacing=100)
    with tifffile.TiffWriter(FOLDER / "big.tif", bigtiff=True, byteorder=">") as out:
        for page in range(3):
            out.write(data[0, page, 0], metadata=None)
    check("bigtiff pages", FOLDER / "big.tif", as_float(data[0, :3, :1]), slices=1, times=3)
    with tifffile.TiffWriter(FOLDER / "sub.tif") as out:  # reduced pages in SubIFDs and in the chain
        for page in range(2):
            out.write(data[0, page, 0], subifds=1, metadata=None)
            out.write(data[0, page, 0, ::2, ::2], subfiletype=1, metadata=None)
            out.write(data[0, page, 0, ::4, ::4], subfiletype=1, metadata=None)
    check("thumbnails", FOLDER / "sub.tif", as_float(data[0, :2, :1]))
    tifffile.imwrite(FOLDER / "white.tif", data[0, 0, 0], photometric="miniswhite", metadata=None)
    check("min is white", FOLDER / "white.tif", (1 - as_float(data[0, 0, 0]))[None, None])
    indices, colours = values((37, 53), "u1"), values((3, 256), "u2")
    tifffile.imwrite(FOLDER / "palette.tif", indices, photometric="palette", colormap=colours, metadata=None)
    check("palette", FOLDER / "palette.tif", as_float(colours)[:, indices][None])
    if not imagecodecs:
        return
    ramp = np.stack([np.add.outer(np.arange(37), np.arange(53) * s).astype("u1") for s in (1, 2, 3)], -1)
    tifffile.imwrite(FOLDER / "jpeg.tif", ramp, photometric="rgb", compression="jpeg", compressionargs=dict(level=100), metadata=None)
    got = read(FOLDER / "jpeg.tif")[0]
    assert np.abs(got[0] - np.moveaxis(ramp, -1, 0) / 255).max() < 0.03


def many_pages():
    """Time per page must not grow with the number of pages."""
    with tifffile.TiffWriter(FOLDER / "many.tif") as out:
        for page in range(3000):
            out.write(np.full((4, 4), page, "u2"), contiguous=False, metadata=None)
    data = read(FOLDER / "many.tif")[0]
    assert np.array_equal(data[:, 0, 0, 0], (np.arange(3000) / 65535).astype(np.float32))


def written(bits, layout, channels, slices, compress):
    rows, cols = 37, 53
    data = RANDOM.random((slices, channels, rows, cols), np.float32)
    if bits == 32:
        data[0, 0, 0, :3] = [np.nan, -1, 2]
    path = FOLDER / "written.tif"
    subprocess.run([TOOL, "write-tiff", path, *map(str, (bits, layout, channels, rows, cols, slices, compress))], check=True,
                   input=data.tobytes())
    full = {8: 255, 16: 65535, 32: 1}[bits]
    expected = data if bits == 32 else np.floor(data.astype(np.float64) * full + 0.5).astype(f"u{bits // 8}")
    distances = [100 + 12.5 * i * i for i in range(slices)]
    with tifffile.TiffFile(path) as file:
        if layout == "stack":
            assert file.is_imagej
            found = file.asarray(squeeze=False).reshape(slices, channels, rows, cols)
            meta = file.imagej_metadata
            assert meta["images"] == slices * channels and meta["channels"] == channels and meta["slices"] == slices
            assert meta["hyperstack"] and meta["mode"] == ("composite" if channels > 1 else "grayscale")
            finite = expected[np.isfinite(expected)]
            if compress:  # the range is not known before the pixels are written
                assert "min" not in meta and "Ranges" not in meta
            else:
                assert np.isclose(meta["min"], finite.min(), rtol=1e-8) and np.isclose(meta["max"], finite.max(), rtol=1e-8)
                assert np.allclose(np.array(meta["Ranges"]).reshape(-1, 2), [[finite.min(), finite.max()]] * channels)
            labels = [meta["Labels"]] if isinstance(meta["Labels"], str) else meta["Labels"]
            assert len(labels) == slices * channels and labels[0].startswith("100 mm"), labels
            if slices > 1:
                assert np.isclose(meta["spacing"], (distances[-1] - distances[0]) / (slices - 1))
                assert labels[channels].startswith("112.5 mm")
            space = "{http://www.openmicroscopy.org/Schemas/OME/2016-06}"
            pixels = xml.fromstring(meta["Info"]).find(f"{space}Image/{space}Pixels")
            assert [int(pixels.get(f"Size{a}")) for a in "XYCZT"] == [cols, rows, channels, slices, 1]
            planes = pixels.findall(f"{space}Plane")
            assert len(planes) == slices * channels
            assert all(float(p.get("PositionZ")) == distances[int(p.get("TheZ"))] for p in planes)
        else:
            found = np.stack([np.moveaxis(p.asarray().reshape(rows, cols, channels), -1, 0) for p in file.pages])
            assert len(file.pages) == slices
        lines = dict(line.split("=", 1) for line in file.pages[0].description.splitlines())
        assert [float(d) for d in lines["distances_mm"].split(",")] == distances and lines["model"] == "test"
        assert bits == 32 or (lines["value_scale"] == "1" and lines["full_scale"] == str(full))
    assert np.array_equal(found, expected, equal_nan=True), (bits, layout, channels, slices, compress)
    check("back", path, as_float(found))


if __name__ == "__main__":
    print(plain_files(), "plain files")
    stacks()
    many_pages()
    for bits in (8, 16, 32):
        for layout in ("stack", "pages"):
            for channels in (1, 2, 3, 4):
                for slices in (1, 5):
                    for compress in (0, 1) if imagecodecs else (0,):
                        written(bits, layout, channels, slices, compress)
    print("ok")
