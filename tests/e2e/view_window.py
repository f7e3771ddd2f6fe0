#!/usr/bin/env python3
"""The viewer as a user drives it: mouse, keys and touch from a file, pictures saved on the way.

SDL's dummy display shows nothing and needs nothing; with Xvfb and xdotool about, the same window is also
driven through a real X server. Run by ctest with SCANCART_BIN set."""
import fcntl
import json
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time

BIN = os.environ["SCANCART_BIN"]
W, H = 96, 72


def run(args, want=0, **env):
    done = subprocess.run([BIN] + args, capture_output=True, text=True, timeout=100,
                          env={**os.environ, **env})
    assert want is None or done.returncode == want, f"{args}: exit {done.returncode}, {done.stderr}"
    return done.stdout + done.stderr


def make_site(folder):
    """One photograph: a slanted wall with a coarse pattern and a hole that nobody measured."""
    site = os.path.join(folder, "site")
    with open(folder + "/c.ppm", "wb") as f:
        f.write(b"P6 %d %d 255\n" % (W, H))
        f.write(bytes(v for y in range(H) for x in range(W)
                      for v in ((220, 60, 40) if (x // 8 + y // 8) % 2 else (40, 120, 220))))
    with open(folder + "/d.pgm", "wb") as f:
        f.write(b"P5 %d %d 65535\n" % (W, H))
        f.write(b"".join(struct.pack(">H", 0 if 40 < x < 48 and 30 < y < 38 else 2000 + 10 * x)
                         for y in range(H) for x in range(W)))
    run(["new", site])
    run(["import", "photo", site, "--image", folder + "/c.ppm", "--depth", folder + "/d.pgm",
         "--hfov-deg", "70"])
    return site


def read(path):
    with open(path, "rb") as f:
        return f.read()


def hands_change_the_picture(site, folder):
    shots = []
    def shot():
        shots.append(f"{folder}/{len(shots)}.png")
        return f"still\nshot {shots[-1]}\n"
    play = shot()
    play += "down 400 200\nmove 420 210\nmove 460 230\nup 460 230\n" + shot()  # turn
    play += "wheel 2\n" + shot()
    play += "key 4\n" + shot()  # plan
    play += "key 2\nkey L\n" + shot()
    play += "finger-down 1 0.5 0.5\nfinger-down 2 0.6 0.5\nfinger-move 2 0.7 0.5\n"
    play += "finger-up 1 0.5 0.5\nfinger-up 2 0.7 0.5\n" + shot()  # pinch
    play += "key H\nkey M\ndown 600 300\nup 600 300\ndown 700 350\nup 700 350\n" + shot()  # measure
    play += "size 320 240\nframes 3\n" + shot() + "size 1 1\nframes 3\nquit\n"
    with open(folder + "/play.txt", "w") as f:
        f.write(play)
    run(["view", site, "--cpu", "--play", folder + "/play.txt"], SDL_VIDEODRIVER="dummy")
    pictures = [read(s) for s in shots]
    assert len(set(pictures)) == len(pictures), "an action changed nothing"
    assert struct.unpack(">II", pictures[-1][16:24]) == (320, 240), "the window did not resize"


def bad_input_is_said(site, folder):
    with open(folder + "/bad.txt", "w") as f:
        f.write("key w\njump\n")
    text = run(["view", site, "--cpu", "--play", folder + "/bad.txt"], 1, SDL_VIDEODRIVER="dummy")
    assert "bad.txt:2" in text, text
    assert "SCANCART_NO_GL" in run(["view", site, "--gl"], 1, SDL_VIDEODRIVER="dummy", SCANCART_NO_GL="1")
    assert "no display" in run(["view", site, "--cpu"], 1, SDL_VIDEODRIVER="nonesuch")
    empty = folder + "/empty"
    run(["new", empty])
    assert "nothing to show" in run(["view", empty, "--cpu"], 1, SDL_VIDEODRIVER="dummy")


def notes_and_views_are_kept(site, folder):
    with open(folder + "/notes.txt", "w") as f:
        f.write("still\ndown 820 250\nup 820 250\nkey N\ntype a crack\nkey Return\nkey K\n"
                "frames 2\nquit\n")
    run(["view", site, "--cpu", "--play", folder + "/notes.txt"], SDL_VIDEODRIVER="dummy")
    kept = json.loads(read(site + ".notes.json"))
    assert kept["notes"][0]["text"] == "a crack" and len(kept["views"]) == 1, kept
    with open(folder + "/back.txt", "w") as f:
        f.write(f"still\nshot {folder}/n0.png\nkey 4\nstill\nkey R\nstill\nframes 2\n"
                f"shot {folder}/n1.png\nquit\n")
    run(["view", site, "--cpu", "--play", folder + "/back.txt"], SDL_VIDEODRIVER="dummy")
    assert read(folder + "/n0.png") != read(folder + "/n1.png")  # says which view it is
    with open(site + ".notes.json", "w") as f:
        f.write("[1, 2")
    run(["view", site, "--cpu", "--play", folder + "/notes.txt"], SDL_VIDEODRIVER="dummy")
    assert read(site + ".notes.json") == b"[1, 2", "somebody's file was written over"
    os.remove(site + ".notes.json")


def damaged_tile_is_said_and_the_rest_shown(site, folder):
    """A pack with a byte turned over in its last tile: the picture changes little or not at all."""
    broken = folder + "/broken"
    shutil.copytree(site, broken)
    run(["fuse", broken])
    run(["fly", broken, "--cpu", "-o", folder + "/whole", "--seconds", "1", "--fps", "1", "--size", "320x240"])
    pack = os.path.join(broken, "tiles", os.listdir(broken + "/tiles")[0])
    data = bytearray(read(pack))
    data[-20] ^= 0xff
    os.chmod(pack, 0o644)
    with open(pack, "wb") as f:
        f.write(data)
    out = run(["fly", broken, "--cpu", "--live", "--seconds", "1", "--size", "640x480", "--json"])
    assert json.loads(out)["damaged_tiles"] == 1, out
    run(["fly", broken, "--cpu", "-o", folder + "/part", "--seconds", "1", "--fps", "1", "--size", "320x240"])
    assert len(read(folder + "/part/00000.png")) > 0.5 * len(read(folder + "/whole/00000.png"))
    with open(pack, "wb") as f:  # no pack at all: the photographs still show everything
        f.write(b"nonsense")
    run(["fly", broken, "--cpu", "-o", folder + "/photos", "--seconds", "1", "--fps", "1", "--size", "320x240"])
    assert len(read(folder + "/photos/00000.png")) > 0.5 * len(read(folder + "/whole/00000.png"))


def site_that_is_written_is_shown(site, folder):
    """Another process holds the site's write lock and has written what is not committed yet."""
    writer = sqlite3.connect(site + "/site.db", isolation_level=None)
    writer.execute("BEGIN IMMEDIATE")
    writer.execute("CREATE TABLE half_done (x INTEGER)")
    lock = open(site + "/writer.lock", "a")
    fcntl.lockf(lock, fcntl.LOCK_EX)
    try:
        run(["fly", site, "--cpu", "-o", folder + "/busy", "--seconds", "1", "--fps", "1", "--size", "160x90"])
        assert os.listdir(folder + "/busy") == ["00000.png"]
    finally:
        writer.execute("ROLLBACK")
        writer.close()
        lock.close()


def no_gl_falls_back_and_says_so(site, folder):
    shots = []
    with open(folder + "/nogl.txt", "w") as f:
        f.write(f"frames 3\nshot {folder}/nogl.png\nquit\n")
    run(["view", site, "--play", folder + "/nogl.txt"], SDL_VIDEODRIVER="dummy", SCANCART_NO_GL="1")
    # A GL of version 2 only: Mesa can be told to be that old.
    for path in ("--gl", "--gl31"):
        text = run(["view", site, path, "--play", folder + "/nogl.txt"], None, SDL_VIDEODRIVER="dummy",
                   MESA_GLES_VERSION_OVERRIDE="2.0")
        shots.append("OpenGL ES 3" in text or "EGL" in text)
    print("with GLES 2 only:", "refused with a reason" if all(shots) else "this GL does not pretend to be old")


def flight_is_saved(site, folder):
    out = folder + "/flight"
    run(["fly", site, "--cpu", "-o", out, "--seconds", "1", "--fps", "3", "--size", "160x90"])
    names = sorted(os.listdir(out))
    assert names == ["00000.png", "00001.png", "00002.png"], names
    assert read(out + "/" + names[0]) != read(out + "/" + names[2])


def real_window_obeys_xdotool(site):
    if not shutil.which("Xvfb") or not shutil.which("xdotool"):
        print("SKIP: no Xvfb and xdotool")
        return
    read_end, write_end = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(write_end), "-screen", "0", "1000x700x24"],
                              pass_fds=[write_end], stderr=subprocess.DEVNULL)
    viewer = None
    try:
        display = ":" + os.read(read_end, 16).decode().strip()
        env = {**os.environ, "DISPLAY": display, "SDL_VIDEODRIVER": "x11"}
        viewer = subprocess.Popen([BIN, "view", site, "--cpu", "--size", "900x600"], env=env)
        found = subprocess.run(["xdotool", "search", "--sync", "--name", "scancart"], env=env,
                               timeout=60, capture_output=True, text=True).stdout.split()
        assert found, "no window"
        time.sleep(1.0)  # the first frame
        subprocess.run(["xdotool", "mousemove", "400", "300", "click", "1", "key", "--window", found[0],
                        "l", "key", "--window", found[0], "Escape"], env=env, timeout=30, check=True)
        assert viewer.wait(60) == 0
    finally:
        for process in (viewer, server):
            if process and process.poll() is None:
                process.terminate()


def main():
    with tempfile.TemporaryDirectory() as folder:
        site = make_site(folder)
        hands_change_the_picture(site, folder)
        bad_input_is_said(site, folder)
        notes_and_views_are_kept(site, folder)
        damaged_tile_is_said_and_the_rest_shown(site, folder)
        site_that_is_written_is_shown(site, folder)
        no_gl_falls_back_and_says_so(site, folder)
        flight_is_saved(site, folder)
        real_window_obeys_xdotool(site)
    print("view_window: all as it should be")


if __name__ == "__main__":
    sys.exit(main())
