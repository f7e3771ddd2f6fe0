#!/usr/bin/python3
"""Real backends on real kernel devices: Debian's kernel in QEMU, with this tree read-only over 9p. In it
  a camera           vivid, /dev/video0
  a rangefinder head dummy_hcd and a FunctionFS gadget (tests/support/vm_head.c)
  GPIO lines         uhid and hid-cp2112 with a chip in user space (tests/support/vm_gpio.c)
  the controller     its image in a second QEMU, joined to the machine's serial port
The first processes are busybox's; then tests/e2e/vm_inside.sh runs in the tree. Skips where the kernel's package
cannot be had. Everything is bounded.

Usage: vm_capture.py [BUILD_FOLDER]      default: $SCANCART_BUILD
"""
import fcntl
import glob
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from controller_bench import ROOT, image, program, realtime, skip  # noqa: E402

LIMIT_S = 270  # for the machine; it takes 40 s when nobody else works
GAP_US = 10000  # end-of-frame gap of the emulated controller
CACHE = os.path.join(ROOT, "build/vm")
# In the order in which they are loaded, after what they depend on.
MODULES = ["virtio_pci", "9pnet_virtio", "9p", "uhid", "hid_cp2112", "dummy_hcd", "libcomposite", "usb_f_fs", "vivid"]
FOLDERS = ["drivers/virtio", "drivers/hid", "drivers/usb", "drivers/media", "net/9p", "fs/9p", "fs/netfs", "fs/fscache",
           "fs/configfs"]


# --- the kernel --------------------------------------------------------------------------------------------

def newest_kernel():
    """Name of the package of Debian's current kernel."""
    out = subprocess.run(["apt-cache", "depends", "linux-image-amd64"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"Depends: (linux-image-\S+-amd64)", out)
    return found.group(1) if found else None


def apt(arguments, folder, limit_s):
    """Runs apt-get; a network that does not answer is no error of this test."""
    try:
        subprocess.run(["apt-get", "-q"] + arguments, cwd=folder, capture_output=True, timeout=limit_s, check=False)
    except subprocess.TimeoutExpired:
        pass


def download(folder):
    """The package's file, or None."""
    for update in (False, True):  # an old package list is the usual reason of a failure
        if update:
            apt(["update"], folder, 60)
        package = newest_kernel()
        if package:
            apt(["download", package], folder, 60)
            found = glob.glob(os.path.join(folder, "*.deb"))
            if found:
                return found[0]
    return None


def unpack(package, folder):
    tar = subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE)
    wanted = ["./boot/vmlinuz-*"] + [f"./lib/modules/*/kernel/{f}/*" for f in FOLDERS]
    subprocess.run(["tar", "-x", "-C", folder, "--wildcards"] + wanted, stdin=tar.stdout, check=True)
    tar.stdout.close()
    if tar.wait():
        raise RuntimeError("dpkg-deb failed")


def kernel():
    """Folder with boot/ and lib/modules/, kept for the next time."""
    for name in ("apt-get", "apt-cache", "dpkg-deb"):
        program(name)
    os.makedirs(CACHE, exist_ok=True)
    folder = os.path.join(CACHE, "kernel")
    with open(os.path.join(CACHE, "lock"), "w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not os.path.isdir(folder):
            with tempfile.TemporaryDirectory(dir=CACHE) as scratch:
                os.chmod(scratch, 0o755)
                package = download(scratch)
                if not package:
                    skip("no kernel package (linux-image-amd64) can be had")
                part = os.path.join(scratch, "kernel")
                os.mkdir(part)
                unpack(package, part)
                os.rename(part, folder)
    return folder


def in_order(folder):
    """Paths of MODULES and of all they depend on, in the order in which they can be loaded."""
    paths = {os.path.basename(p)[:-3].replace("-", "_"): p
             for p in glob.glob(os.path.join(folder, "lib/modules/*/kernel/**/*.ko"), recursive=True)}
    order = []

    def add(name):
        with open(paths[name], "rb") as module:
            depends = re.search(rb"\0depends=([^\0]*)\0", module.read()).group(1).decode()
        for other in filter(None, depends.replace("-", "_").split(",")):
            if other not in order:
                add(other)
        order.append(name)

    for name in MODULES:
        if name not in order:
            add(name)
    return [paths[name] for name in order]


# --- the machine -------------------------------------------------------------------------------------------

INIT = """#!/bin/busybox sh
export PATH=/bin
/bin/busybox --install -s /bin
mount -t proc none /proc; mount -t sysfs none /sys; mount -t devtmpfs none /dev
for m in MODULES; do insmod /modules/$m.ko PARAMETERS || echo "VM no module $m"; done
mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=524288,cache=loose tree /tree || poweroff -f
mount -t tmpfs -o size=600m none /tree/run; mkdir /tree/run/vm /tree/run/ffs
mount -t configfs none /sys/kernel/config
for d in proc dev; do mount -o bind /$d /tree/$d; done
mount -o rbind /sys /tree/sys
cd /tree/run/vm
chroot /tree /bin/sh ROOT/tests/e2e/vm_inside.sh ROOT BUILD </dev/null 2>&1
echo "VM result $?"
poweroff -f
"""


def initramfs(modules, build, out_path):
    with tempfile.TemporaryDirectory() as root:
        for folder in ("bin", "proc", "sys", "dev", "tree", "modules"):
            os.mkdir(os.path.join(root, folder))
        shutil.copy(shutil.which("busybox"), os.path.join(root, "bin/busybox"))
        for path in modules:
            shutil.copy(path, os.path.join(root, "modules"))
        names = " ".join(os.path.basename(p)[:-3] for p in modules)
        # vivid: one camera, nothing else (node_types bit 0: video capture)
        init = INIT.replace("MODULES", names).replace("ROOT", ROOT).replace("BUILD", build)
        init = init.replace("PARAMETERS", "$([ $m = vivid ] && echo n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0)")
        with open(os.path.join(root, "init"), "w", encoding="utf-8") as out:
            out.write(init)
        os.chmod(os.path.join(root, "init"), 0o755)
        with open(out_path, "wb") as out:
            find = subprocess.run(["find", "."], cwd=root, capture_output=True, check=True).stdout
            subprocess.run([program("cpio"), "-o", "-H", "newc", "--quiet"], cwd=root, input=find, stdout=out, check=True)


def controller(elf, line):
    """The controller's image; its line is the machine's second serial port, a socket."""
    return subprocess.Popen(
        ["timeout", "-k", "5", str(LIMIT_S)] + realtime() +
        ["qemu-system-arm", "-M", "mps2-an386", "-kernel", elf, "-display", "none", "-monitor", "none",
         "-icount", "shift=5",  # its time stands still with it, so that its patience is not that of a busy machine
         "-device", f"loader,addr=0x21000400,data={GAP_US},data-len=4",
         "-chardev", f"socket,id=line,path={line}", "-serial", "chardev:line"],
        stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def machine(boot, initrd, line):
    return subprocess.Popen(
        ["timeout", "-k", "5", str(LIMIT_S), "qemu-system-x86_64", "-accel", "tcg,thread=multi,tb-size=256", "-cpu",
         "Nehalem", "-smp", "2", "-m", "768", "-display", "none", "-monitor", "none", "-no-reboot", "-nic", "none", "-kernel", boot, "-initrd", initrd,
         "-append", "console=ttyS0 quiet loglevel=4 panic=1 " +
         "mitigations=off nokaslr rcupdate.rcu_expedited=1 clocksource=hpet",  # a time counter that load cannot mislead
         "-fsdev", "local,id=tree,path=/,security_model=none,readonly=on,multidevs=remap",
         "-device", "virtio-9p-pci,fsdev=tree,mount_tag=tree",
         "-serial", "stdio", "-chardev", f"socket,id=line,path={line},server=on,wait=off", "-serial", "chardev:line"],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")


def main():
    build = os.path.abspath(sys.argv[1] if len(sys.argv) > 1 else os.environ["SCANCART_BUILD"])
    for name in ("qemu-system-x86_64", "qemu-system-arm", "busybox", "cpio"):
        program(name)
    folder, elf = kernel(), image("qemu_mps2")
    result, running = None, []
    with tempfile.TemporaryDirectory(prefix="scancart-vm-") as scratch:
        initrd, line = os.path.join(scratch, "initrd"), os.path.join(scratch, "line")
        initramfs(in_order(folder), build, initrd)
        vm = machine(glob.glob(os.path.join(folder, "boot/vmlinuz-*"))[0], initrd, line)
        running.append(vm)
        start = time.monotonic()
        try:
            for text in vm.stdout:
                print(f"{time.monotonic() - start:6.1f} {text.rstrip()}", flush=True)
                if text.startswith("VM up "):  # the controller would only take time while the kernel boots
                    running.append(controller(elf, line))
                elif text.startswith("VM result "):
                    result = int(text.split()[2])
        finally:
            for process in running:
                process.terminate()
                process.wait()
    if result is None:
        print("the virtual machine did not come to an end")
    sys.exit(1 if result is None else result)


main()
