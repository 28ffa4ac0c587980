#!/usr/bin/env python3
"""Reconstructs frames on a cluster of two workers: dask_cluster.py MODEL FOLDER FRAME.tif ...

FOLDER gets all_in_focus.tif and distance_map.tif, a page a frame. Frames are read by the workers, each of which has
half of the first device's compute units; with two GPUs the devices are "0" and "1". On a cluster that is there
already, Client("tcp://scheduler:8786") takes the place of LocalCluster. Needs hadalens[dask] and tifffile.
"""

from __future__ import annotations

import sys
from pathlib import Path

import dask
import dask.array as da
import hadalens
import hadalens.dask
import tifffile
from dask.distributed import Client, LocalCluster

HALVES = ["0:1/2", "0:2/2"]


def main(model: Path, folder: Path, files: list[Path]) -> None:
    """Start the cluster, hand it the frames, write what comes back."""
    camera = hadalens.Model.load(model)
    first = tifffile.imread(files[0])
    read = dask.delayed(tifffile.imread)
    frames = da.stack([da.from_delayed(read(file), first.shape, first.dtype) for file in files])
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster),
        dask.config.set({"distributed.worker.daemon": False}),
    ):
        axis = -1 if first.ndim == 3 else None
        results = hadalens.dask.reconstruct(frames, camera, channel_axis=axis, devices=HALVES)
        pictures, maps = dask.compute(results.all_in_focus, results.distance_map)
    folder.mkdir(parents=True, exist_ok=True)
    hadalens.write_tiff(folder / "all_in_focus.tif", pictures)
    hadalens.write_tiff(folder / "distance_map.tif", maps[:, None])


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]), [Path(name) for name in sys.argv[3:]])
