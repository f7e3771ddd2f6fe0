#!/usr/bin/env python3
"""`scancart import` and `scancart panorama` as a user runs them, on small files made here; what is wrong with
an input is one line, exit status 1, and a site that is byte for byte what it was."""
import hashlib
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "support"))
import import_inputs as inputs  # noqa: E402

PROGRAM = os.environ["SCANCART_BIN"]
CAMERA = ["--fx", "60", "--cx", "31", "--cy", "24.5"]


def run(*arguments, status=0):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60)
    assert done.returncode == status, (arguments, done.returncode, done.stdout, done.stderr)
    return done


def run_json(*arguments):
    return json.loads(run(*arguments, "--json").stdout)


def digest(site):
    """All files of the site but the lock, which is empty and held only while writing."""
    total = hashlib.sha256()
    for path in sorted(site.rglob("*")):
        if path.is_file() and path.name != "writer.lock":
            total.update(str(path.relative_to(site)).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def refused(site, message, *arguments):
    before = digest(site)
    done = run(*arguments, status=1)
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("scancart import"), done.stderr
    assert message in lines[0], (message, lines[0])
    assert digest(site) == before, f"the site changed: {arguments}"


def good(site):
    assert run_json("check", site)["good"] is True


def photographs(site, work):
    inputs.write_ppm(work / "a.ppm")
    inputs.write_pgm16(work / "depth.pgm", inputs.depth_mm)
    inputs.write_pgm16(work / "disparity.pgm", inputs.disparity_px)
    made = run_json("import", "photo", site, "--image", work / "a.ppm", "--depth", work / "depth.pgm",
                    *CAMERA)["photos"][0]
    assert made["name"] == "a" and made["station"] == "a" and made["length_unit"] == "m"
    assert made["unknown_pixels"] == 12 and made["known_pixels"] == 64 * 48 - 12
    assert abs(made["nearest"] - 2.0) < 1e-6 and abs(made["farthest"] - 2.865) < 1e-6
    assert made["file_bytes"] <= 9 * 64 * 48 + 8192
    refused(site, "has a photograph a already", "import", "photo", site, "--image", work / "a.ppm",
            "--depth", work / "depth.pgm", *CAMERA)
    run("import", "photo", site, "--image", work / "a.ppm", "--depth", work / "depth.pgm", *CAMERA,
        "--replace")
    made = run_json("import", "photo", site, "--image", work / "a.ppm", "--disparity",
                    work / "disparity.pgm", "--disparity-step", 1, "--hfov-deg", 50, "--name", "pair",
                    "--station", "a", "--k1", "-0.1")["photos"][0]
    assert made["length_unit"] == "baseline" and made["dequantised"] and made["undistorted"]
    good(site)


def photograph_lists(site, work):
    text = ("up: -y\ncamera: {fx_px: 60, cx_px: 31}\nmap: {kind: depth, scale: 0.001, sigma_m: 0.002}\n"
            "station: room\nphotos:\n"
            "  - {name: one, image: a.ppm, map: depth.pgm, pose: [0, 0, 0, 0, 0, 0, 1]}\n"
            "  - {name: two, image: a.ppm, map: depth.pgm, pose: [0.5, 0, 0.25, 0, 0.1, 0, 1]}\n")
    (work / "list.yaml").write_text(text)
    made = run_json("import", "photo", site, "--list", work / "list.yaml")["photos"]
    assert [p["name"] for p in made] == ["one", "two"]
    good(site)
    text = text.replace("room", "hall")
    for bad, message in ((text.replace("fx_px", "fx"), "list.yaml:2: camera: no such key 'fx'"),
                         (text.replace("two", "one"), "gets a photograph one twice"),
                         (text.replace("0.5, 0,", ""), "pose: a list of 5"),
                         (text.replace("0.1, 0, 1]", "0, 0, 0]"), "quaternion"),
                         (text.replace("0.001", "-1"), "map.scale: -1 is not within"),
                         (text.replace("kind: depth", "kind: deepth"), "list.yaml:3: map.kind"),
                         (text.replace("map: depth.pgm", "map: no.pgm"), "no.pgm"),
                         ("photos: [", "list.yaml"), ("", "list.yaml")):
        (work / "list.yaml").write_text(bad)
        refused(site, message, "import", "photo", site, "--list", work / "list.yaml")


def absurd_png(width, height):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b""))


def bad_pictures(site, work):
    whole = (work / "depth.pgm").read_bytes()
    inputs.write_pgm16(work / "small.pgm", inputs.depth_mm, 63, 48)
    inputs.write_pgm16(work / "zero.pgm", lambda u, v: 0)
    cases = [("empty.pgm", b"", "empty"), ("cut.pgm", whole[:len(whole) // 2], "cut.pgm"),
             ("huge.pgm", b"P5\n999999999 999999999\n65535\n" + whole[-100:], "huge.pgm"),
             ("huge.png", absurd_png(2**31 - 1, 2**31 - 1), "huge.png"),
             ("cut.png", absurd_png(64, 48)[:60], "cut.png"),
             ("short.png", absurd_png(64, 48), "short.png"), ("text.png", b"hello", "text.png"),
             ("small.pgm", None, "64 x 48"), ("zero.pgm", None, "no known value")]
    for name, data, message in cases:
        if data is not None:
            (work / name).write_bytes(data)
        refused(site, message, "import", "photo", site, "--image", work / "a.ppm", "--depth", work / name,
                *CAMERA, "--name", "bad")
    refused(site, "missing.ppm", "import", "photo", site, "--image", work / "missing.ppm", "--depth",
            work / "depth.pgm", *CAMERA)


def scans(site, work):
    (work / "stand1.3d").write_text(inputs.scan_text())
    (work / "stand1.pose").write_text("100 20 300\n0 90 0\n")
    (work / "dome.ply").write_text(inputs.ply_text())
    (work / "dome.conf").write_text("camera 0 0 0 0 0 0 1\nbmesh dome.ply 1 2 3 0 0 0 1\n")
    made = run_json("import", "scan", site, work / "stand1.3d", "--panorama", work / "pano.png")
    station = made["stations"][0]
    assert (station["rows"], station["columns"], station["samples"]) == (20, 30, 600)
    assert station["posed"] and 0 < station["no_returns"] < 60
    assert (work / "pano.png").read_bytes()[:4] == b"\x89PNG"
    made = run_json("import", "scan", site, work / "dome.ply", "--conf", work / "dome.conf", "--up", "y")
    assert made["stations"][0]["posed"] and len(made["stations"][0]["photos"]) == 1
    (work / "scans.yaml").write_text("up: y\nconf: dome.conf\nscans:\n  - {name: listed, file: dome.ply}\n"
                                     "  - {name: posed, file: dome.ply, pose: [0, 0, 1, 0, 0, 0, 1]}\n"
                                     "  - {name: turned, file: stand1.3d, pose_file: stand1.pose}\n")
    made = run_json("import", "scan", site, "--list", work / "scans.yaml")
    assert [s["name"] for s in made["stations"]] == ["listed", "posed", "turned"]
    drawn = run_json("panorama", site, "--station", "stand1", "-o", work / "again.png")
    assert drawn["no_returns"] == station["no_returns"] and drawn["surfaces"] == station["surfaces"]
    assert (work / "again.png").read_bytes() == (work / "pano.png").read_bytes()
    good(site)


def bad_scans(site, work):
    scan, ply = inputs.scan_text(), inputs.ply_text()
    cases = [("empty.3d", "", "empty"), ("text.3d", "once upon a time\n", "line 1"),
             ("cut.3d", scan[:700] + "1 2", "cut.3d"), ("nan.3d", "nan nan nan\n" + scan, "line 1"),
             ("huge.3d", "1e300 0 0\n" + scan, "no coordinate"), ("cut.ply", ply[:2000], "cut.ply"),
             ("head.ply", ply[:100], "head.ply"),
             ("many.ply", ply.replace("element vertex ", "element vertex 9999999"), "cannot be in"),
             ("plain.ply", ply.replace("range_grid", "face"), "no range_grid"),
             ("grid.ply", ply.replace("num_rows 24", "num_rows 23"), "do not make")]
    for name, text, message in cases:
        (work / name).write_text(text)
        refused(site, message, "import", "scan", site, work / name)
    (work / "bad.pose").write_text("1 2 three\n")
    refused(site, "bad.pose: line 1", "import", "scan", site, work / "stand1.3d", "--name", "other",
            "--pose", work / "bad.pose")
    refused(site, "station stand1 is in the site already", "import", "scan", site, work / "stand1.3d")
    # the second of two is bad: the first must not be there either
    (work / "first.3d").write_text(scan)
    refused(site, "text.3d", "import", "scan", site, work / "first.3d", work / "text.3d")
    (work / "other.conf").write_text("bmesh else.ply 1 2 3 0 0 0 1\n")
    shutil.copy(work / "dome.ply", work / "dome2.ply")
    refused(site, "no line of it names dome2.ply", "import", "scan", site, work / "dome2.ply", "--conf",
            work / "other.conf")


def spin_folder(work, name, points=None, calib=inputs.SPIN_CALIB, size=(64, 48)):
    folder = work / name
    folder.mkdir()
    (folder / "velodyne.bin").write_bytes(inputs.spin_points() if points is None else points)
    if calib is not None:
        (folder / "calib.txt").write_text(calib)
    if size:
        inputs.write_png(folder / "image.png", *size)
    return folder


def spinning_laser(site, work):
    """Points, image and calibration of a folder become a station that fuse makes photographs of."""
    folder = spin_folder(work, "drive")
    made = run_json("import", "scan", site, str(folder) + "/")["stations"][0]
    assert (made["name"], made["rows"], made["samples"]) == ("drive", 32, 32 * 720), made
    assert made["frame"]["width_px"] == 64 and made["frame"]["fx_px"] == 60
    # the camera: a quarter metre ahead, a tenth to the left of the laser by P2's last column
    assert abs(made["frame"]["x_m"] - 0.25) < 1e-9 and abs(made["frame"]["y_m"] - 0.1) < 1e-9
    # the dataset as published: velodyne/N.bin, image_2/N.png, calib/N.txt
    tree = work / "training"
    for part, name, take in (("velodyne", "7.bin", "velodyne.bin"), ("image_2", "7.png", "image.png"),
                             ("calib", "7.txt", "calib.txt")):
        (tree / part).mkdir(parents=True)
        shutil.copy(folder / take, tree / part / name)
    made = run_json("import", "scan", site, tree / "velodyne" / "7.bin")["stations"][0]
    assert made["name"] == "7" and made["frame"]["height_px"] == 48
    alone = spin_folder(work, "alone", calib=None)
    done = run("import", "scan", site, alone)
    assert "no camera frame (no calib.txt" in done.stdout, done.stdout
    good(site)


def spinning_laser_fused(site, work):
    """In a site of its own: the wall ahead, 4 m from the laser, is 3.75 m from the camera."""
    import cv2
    own = work / "spun"
    run("new", own)
    run("import", "scan", own, work / "drive")
    fused = run_json("fuse", own)
    station = fused["stations"][0]
    # no better than the import says, though every range here is exact
    assert station["range_sigma_m"] == 0.02 and station["range_sigma_measured"] is False, station
    assert "drive-frame1" in run("info", own).stdout
    run("shot", own, "--photo", "drive-frame1", "--photos", "drive-frame1", "-p", "mesh", "-o", work / "frame.png",
        "--depth16", work / "depth.png")
    depth_mm = cv2.imread(str(work / "depth.png"), cv2.IMREAD_UNCHANGED)
    seen = cv2.imread(str(work / "frame.png"))[16:32, 16:48]
    true = cv2.imread(str(work / "drive" / "image.png"))[16:32, 16:48]
    assert depth_mm.shape == (48, 64)
    assert abs(depth_mm[16:32, 16:48].astype(float) - 3750).max() <= 2, depth_mm[16:32, 16:48]
    difference = abs(seen.astype(int) - true.astype(int))
    assert (difference <= 8).mean() > 0.9, difference.mean()
    good(own)


def bad_spinning_lasers(site, work):
    whole, nan = inputs.spin_points(), struct.pack("<4f", float("nan"), 0, 0, 0)
    lines = inputs.SPIN_CALIB.splitlines(keepends=True)
    cases = [("size", {"points": whole[:-3]}, "16 bytes"), ("none", {"points": b""}, "empty"),
             ("nan", {"points": whole[:160] + nan + whole}, "point 10: number 1 is not finite"),
             ("zero", {"points": bytes(160)}, "no point"),
             ("noise", {"points": b"\x7f" * 1600}, "point 0"),
             ("p2", {"calib": "".join(lines[:1] + lines[2:])}, "no line P2:"),
             ("r0", {"calib": "".join(lines[:2] + lines[3:])}, "no line R0_rect:"),
             ("tr", {"calib": "".join(lines[:3])}, "no line Tr_velo_to_cam:"),
             ("empty", {"calib": ""}, "calib.txt: the file is empty"),
             ("short", {"calib": inputs.SPIN_CALIB[:-12]}, "number"),
             ("turn", {"calib": inputs.SPIN_CALIB.replace("0 -1 0 0 0", "0 -9 0 0 0")}, "no rotation"),
             ("small", {"size": (32, 24)}, "not the one that was calibrated")]
    for name, what, message in cases:
        refused(site, message, "import", "scan", site, spin_folder(work, "bad-" + name, **what))
    cut = spin_folder(work, "bad-image")
    (cut / "image.png").write_bytes((cut / "image.png").read_bytes()[:200])
    refused(site, "image.png", "import", "scan", site, cut)
    (work / "nothing").mkdir()
    refused(site, "no velodyne.bin", "import", "scan", site, work / "nothing")
    refused(site, "station drive is in the site already", "import", "scan", site, work / "drive")
    refused(site, "takes no pose file", "import", "scan", site, work / "drive", "--name", "posed", "--pose",
            work / "stand1.pose")
    # the second of two is bad: the first must not be there either
    refused(site, "16 bytes", "import", "scan", site, spin_folder(work, "fine"), work / "bad-size")


def wrong_usage(site, work):
    for arguments in (["import"], ["import", "cake", site], ["import", "photo"], ["import", "photo", site],
                      ["import", "photo", site, "--image", "a", "--depth", "b"],
                      ["import", "photo", site, "--image", "a", "--depth", "b", "--range", "c", "--fx", "9"],
                      ["import", "photo", site, "--image", "a", "--depth", "b", "--fx", "9", "--pose", "1,2"],
                      ["import", "photo", site, "--image", "a", "--depth", "b", "--fx", "9", "--up", "x"],
                      ["import", "scan", site], ["import", "scan", site, "a", "b", "--name", "c"],
                      ["panorama", site], ["panorama"]):
        assert run(*arguments, status=2).stderr.count("\n") == 1, arguments
    for kind in (["import"], ["import", "photo"], ["import", "scan"], ["panorama"]):
        assert "xample" in run(*kind, "--help").stdout or kind == ["import"]
    refused(work / "s", "no-such-site", "import", "scan", work / "no-such-site", work / "stand1.3d")


def main():
    work = pathlib.Path(tempfile.mkdtemp(prefix="scancart-test-"))
    try:
        site = work / "s"
        run("new", site)
        for step in (photographs, photograph_lists, bad_pictures, scans, bad_scans, spinning_laser,
                     spinning_laser_fused, bad_spinning_lasers, wrong_usage):
            step(site, work)
            print(f"{step.__name__}: good")
        good(site)
    finally:
        shutil.rmtree(work)


main()
