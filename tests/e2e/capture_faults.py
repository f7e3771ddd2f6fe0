#!/usr/bin/env python3
"""Every fault of the simulated cart let loose during `scancart capture`: what the operator is told, how
the scan and the cart end, what the ledger says. Compares with docs/capture-faults.md, or writes it
(--write). Needs SCANCART_BIN."""
import json
import os
import re
import subprocess
import sys
import tempfile

PAGE = "docs/capture-faults.md"
BOUND_S = 120  # of one scan, wall clock: nothing hangs

# Seconds of cart time: the sweep lasts from about 11 to 24 s, the photograph comes some 10 s later.
FAULTS = [
    None,
    "packet_lost@16=5",
    "packet_repeated@16",
    "packet_sequence@16=1000",
    "bit_error@16+0.5=3",
    "head_reset@16=0.5",
    "encoder_slip@16=3",
    "index_missing@16+1",
    "mirror_stall@16+5",
    "mirror_surge@16+3=1.3",
    "pan_stall@16+2",
    "missed_steps@16=4",
    "modbus_noise@16+5=0.01",
    "modbus_silence@16+1",
    "modbus_silence@16+10",
    "frame_dropped@26+200",
    "exposure_late@26+200=2",
    "light_change@26+200=0.5",
    "clock_jump@16=0.25",
    "clock_jump@16=-5",
    "disk_full@16+200",
    "power_loss@16",
    "estop@16+2",
    "interlock@16+2",
]

HEAD = """<!-- Written by tests/e2e/capture_faults.py --write from what it saw; a test compares. -->
# Faults during a scan

Each fault of the simulated cart (`scancart twin list` explains them) is let loose during a small scan in
virtual time: sweep of 8 degrees with few samples, one photograph. Given are what the operator is told (the line
on stderr; warnings come with the status lines and after the scan), how the scan ended, in what state the
cart was left, and what the ledger says. Every scan must end within {bound} s of wall clock and leave a site that
`scancart check` accepts; after each that did not end by itself, `--resume` without the fault must complete it.

| fault | the operator is told | scan | cart | ledger and counters | resumed |
|---|---|---|---|---|---|
"""


def scan(binary, folder, site, extra):
    board = os.path.join(folder, "board.yaml")
    if not os.path.exists(board):
        with open(board, "w", encoding="utf-8") as f:
            f.write("name: twin\ntwin:\n  scene: room\n")
    command = [binary, "capture", site, "--board", board, "--json",
               "--set", "head.samples_hz=2500", "--set", "camera.width_px=64", "--set",
               "camera.height_px=96", "--set", "camera.rays_per_pixel=1"] + extra
    done = subprocess.run(command, capture_output=True, text=True, timeout=BOUND_S, check=False,
                          env={**os.environ, "OMP_NUM_THREADS": "1"})
    try:
        report = json.loads(done.stdout)
    except ValueError:
        report = {}
    return done.returncode, report, done.stderr


def told(stderr, site):
    lines = [l.replace(site, "SITE") for l in stderr.splitlines()]
    lines = [l for l in lines if l.startswith(("warning:", "scancart capture:"))]
    text = "; ".join(l.replace("scancart capture: ", "") for l in lines) or "—"
    return re.sub(r"\s+", " ", text).replace("|", "/")


def ledger(report):
    if not report:
        return "—"
    parts = ["%d %s" % (l["items"], l["reason"]) for l in report["ledger"]]
    p, c = report["packets"], report["clocks"]
    for key, text in (("repeated", "repeated"), ("sequence", "wrong number"), ("resets", "head resets"),
                      ("damaged_bytes", "damaged bytes")):
        if p[key]:
            parts.append("%d %s" % (p[key], text))
    for key, text in (("missing_events", "events missing"), ("missing_edges", "edges missing")):
        if c[key]:
            parts.append("%d %s" % (c[key], text))
    if report["unstored_packets"]:
        parts.append("%s not stored" % ("some packets" if report["unstored_packets"] else ""))
    if report["photos"] < report["photos_planned"] and report["complete"] is False and \
            report["ended"] == "done":
        parts.append("%d photograph missing" % (report["photos_planned"] - report["photos"]))
    return ", ".join(parts) or "nothing lost"


def row(binary, folder, number, fault):
    site = os.path.join(folder, "site%d" % number)
    extra = ["--quality", "preview", "--from", "-176", "--to", "-168", "--photo-step", "360"]
    rc, report, stderr = scan(binary, folder, site, extra + (["--fault", fault] if fault else []))
    check = subprocess.run([binary, "check", site], capture_output=True, text=True, check=False)
    if check.returncode:
        raise SystemExit("%s: the site is not good: %s%s" % (fault, check.stdout, check.stderr))
    resumed = "—"
    if not report.get("complete"):
        rc2, again, stderr2 = scan(binary, folder, site, ["--resume"])
        resumed = "complete" if again.get("complete") and not rc2 else "NO: " + stderr2[-200:]
    if "ON" in report.get("cart", "") and "power_loss" not in fault:
        raise SystemExit("%s: the cart is left with %s" % (fault, report["cart"]))
    if "NO" in resumed:
        raise SystemExit("%s: %s" % (fault, resumed))
    end = report.get("ended", "failed")
    text = "done" if not rc else "ended: " + end
    if report:
        text += ", %.0f %% swept" % (100 * report["swept"])
    cart = "without power" if fault and "power_loss" in fault else report.get("cart", "—")
    return "| %s | %s | %s | %s | %s | %s |\n" % (
        "`%s`" % fault if fault else "none", told(stderr, site), text, cart, ledger(report), resumed)


def main():
    binary = os.environ.get("SCANCART_BIN")
    if not binary or not os.path.exists(binary):
        print("SKIP: SCANCART_BIN names no program")
        return 77
    only = [a for a in sys.argv[1:] if not a.startswith("--")]
    page = HEAD.format(bound=BOUND_S)
    shm = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # thousands of flushes that nobody needs
    with tempfile.TemporaryDirectory(dir=shm) as folder:
        for number, fault in enumerate(FAULTS):
            if only and not any(fault and o in fault for o in only):
                continue
            line = row(os.path.abspath(binary), folder, number, fault)
            if only:
                print(line, end="")
            page += line
    if only:
        return 0
    if "--write" in sys.argv:
        with open(PAGE, "w", encoding="utf-8") as f:
            f.write(page)
        return 0
    with open(PAGE, encoding="utf-8") as f:
        kept = f.read()
    if kept != page:
        for a, b in zip(kept.splitlines(), page.splitlines()):
            if a != b:
                print("is:     %s\nshould: %s" % (b, a))
        print("%s is not what was seen: run tests/e2e/capture_faults.py --write" % PAGE)
        return 1
    print("%d faults end as %s says" % (len(FAULTS) - 1, PAGE))
    return 0


sys.exit(main())
