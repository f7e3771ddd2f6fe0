#!/usr/bin/python3
"""Starts a bench and lets controller_torture loose on it.

Usage: controller_torture.py sim|qemu TORTURE [TRANSACTIONS] [OPTIONS]   TORTURE: the built controller_torture
"""
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from controller_bench import Mps2, Native  # noqa: E402

kind, torture = sys.argv[1:3]
count = sys.argv[3] if len(sys.argv) > 3 else "2000"
limit_s = 100 + int(count) // 20  # 20 a second is slow even for an emulator on a busy machine
if kind == "qemu":
    bench = Mps2(gap_us=4000, limit_s=limit_s)
else:
    bench = Native(os.path.join(os.path.dirname(torture), "controller_sim"), limit_s=limit_s, options=["--fast"])
with bench:
    done = subprocess.run([torture, bench.device, "--transactions", count, *sys.argv[4:]], check=False,
                          timeout=limit_s)
sys.exit(done.returncode)
