#!/usr/bin/env python3
"""3D photographs as other readers see them: tiffinfo lists four sane pages, OpenCV reads the values that went
in. What is not installed is skipped, said aloud."""
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "support"))
import import_inputs as inputs  # noqa: E402

PROGRAM = os.environ["SCANCART_BIN"]
SKIP = 77


def with_tiffinfo(path):
    done = subprocess.run(["tiffinfo", path], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and not done.stderr, done.stderr
    pages = done.stdout.split("=== TIFF directory")[1:]
    assert len(pages) == 4, done.stdout
    for page, name, bits in zip(pages, ("colour", "disparity", "flags", "confidence"), (8, 32, 8, 8)):
        assert f"Page Name: {name}" in page or f'PageName: "{name}"' in page or name in page, page
        assert f"Bits/Sample: {bits}" in page and "Image Width: 64 Image Length: 48" in page, page
    assert "Sample Format: IEEE floating point" in pages[1]
    description = pages[0].split("ImageDescription: ")[1].splitlines()[0]
    camera = json.loads(description)["camera"]
    assert camera["fx_px"] == 60 and camera["cx_px"] == 31 and camera["cy_px"] == 24.5
    print("tiffinfo: good")


def with_opencv(path):
    import cv2
    import numpy
    found, pages = cv2.imreadmulti(str(path), flags=cv2.IMREAD_UNCHANGED)
    assert found and len(pages) == 4, len(pages)
    rgb, disparity, flags, confidence = pages[0][:, :, ::-1], *pages[1:]
    assert disparity.dtype == numpy.float32 and flags.dtype == numpy.uint8
    for v in range(inputs.HEIGHT):
        for u in range(inputs.WIDTH):
            depth = inputs.depth_mm(u, v)
            assert tuple(rgb[v, u]) == inputs.colour(u, v), (u, v)
            assert (flags[v, u] == 2) == (depth == 0) == math.isnan(disparity[v, u]), (u, v)
            assert (confidence[v, u] == 0) == (depth == 0), (u, v)
            if depth:
                assert disparity[v, u] == numpy.float32(1 / (depth * 1e-3)), (u, v)
    print("OpenCV: good")


def main():
    work = pathlib.Path(tempfile.mkdtemp(prefix="scancart-test-"))
    skipped = []
    try:
        inputs.write_ppm(work / "a.ppm")
        inputs.write_pgm16(work / "depth.pgm", inputs.depth_mm)
        for arguments in (["new", work / "s"],
                          ["import", "photo", work / "s", "--image", work / "a.ppm", "--depth",
                           work / "depth.pgm", "--fx", "60", "--cx", "31", "--cy", "24.5"]):
            subprocess.run([PROGRAM, *map(str, arguments)], check=True, timeout=60, capture_output=True)
        (photo,) = (work / "s" / "photos").glob("*.tif")
        if shutil.which("tiffinfo"):
            with_tiffinfo(photo)
        else:
            skipped.append("tiffinfo is not installed")
        try:
            import cv2  # noqa: F401
        except ImportError:
            skipped.append("python3-opencv is not installed")
        else:
            with_opencv(photo)
    finally:
        shutil.rmtree(work)
    for reason in skipped:
        print(f"SKIP: {reason}")
    return SKIP if skipped else 0


sys.exit(main())
