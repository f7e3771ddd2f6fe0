"""A bench for tests of the cart's controller: the image in an emulator, or the native simulation, on a
pseudo-terminal. Every process started here ends with the bench, and at latest after `limit_s`."""
import os
import re
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import time
import tty

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SKIP = 77


def skip(why):
    print("SKIP: " + why)
    sys.exit(SKIP)


def program(name):
    if not shutil.which(name):
        skip(f"no {name}; install scripts/packages-test.txt")
    return name


def image(board):
    """Builds the image of a board and returns its path."""
    program("arm-none-eabi-gcc")
    subprocess.run(["scripts/firmware-build", board], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return os.path.join(ROOT, "build/firmware", board, "scancart.elf")


class Bench:
    """device: path of the serial line. console(letter): does something to the plant."""

    def __init__(self, limit_s):
        self.folder = tempfile.TemporaryDirectory(prefix="scancart-bench-")
        self.process, self.held, self.plant, self.log = None, None, None, b""
        self.limit_s = limit_s

    def start(self, command, pattern):
        """Starts a command whose output names the device by `pattern`."""
        self.process = subprocess.Popen(["timeout", "-k", "5", str(self.limit_s)] + command, stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, bufsize=0)
        line = self.process.stdout.readline().decode()
        found = re.search(pattern, line)
        if not found:
            self.close()
            raise RuntimeError("the bench did not start: " + line + str(command))
        self.device = found.group(1)
        # As long as somebody holds the terminal open, opening and closing it costs the emulator nothing.
        self.held = os.open(self.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.held)

    def close(self):
        if self.held is not None:
            os.close(self.held)
            self.held = None
        if self.plant:
            self.plant.close()
        if self.process:
            self.process.terminate()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
        self.folder.cleanup()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def realtime():
    """Prefix that gives the emulator real-time priority, if allowed: fewer pauses within frames."""
    probe = ["chrt", "-f", "20"]
    if shutil.which("chrt") and subprocess.run(probe + ["true"], stderr=subprocess.DEVNULL).returncode == 0:
        return probe
    return []


def connect_within(path, limit_s):
    """The emulator names its line before it has opened the plant's socket: ask again until it is there."""
    end = time.monotonic() + limit_s
    while True:
        plant = socket.socket(socket.AF_UNIX)
        try:
            plant.connect(path)
            return plant
        except (FileNotFoundError, ConnectionRefusedError):
            plant.close()
            if time.monotonic() > end:
                raise
            time.sleep(0.02)


class Mps2(Bench):
    """The image on QEMU's mps2-an386, with the console of its plant."""

    def __init__(self, gap_us=4000, limit_s=120):
        super().__init__(limit_s)
        program("qemu-system-arm")
        elf = image("qemu_mps2")
        plant = os.path.join(self.folder.name, "plant")
        self.start(realtime() + ["qemu-system-arm", "-M", "mps2-an386", "-kernel", elf, "-display", "none",
                    "-monitor", "none", "-icount", "shift=5",
                    "-device", f"loader,addr=0x21000400,data={gap_us},data-len=4",
                    "-chardev", "pty,id=line", "-serial", "chardev:line",
                    "-chardev", f"socket,id=plant,path={plant},server=on,wait=off",
                    "-serial", "chardev:plant"], r"(/dev/pts/\d+)")
        self.plant = connect_within(plant, 10)
        self.plant.settimeout(5)

    def console(self, letter):
        self.plant.sendall(letter.encode())
        answer = self.plant.recv(1).decode()
        assert answer == letter, answer


class F405(Bench):
    """The cart's image on QEMU's netduinoplus2. Its clocks and pins are stubs there: the image finds no
    crystal and says so; its time base runs 62.5 times too fast, so the end-of-frame gap must be given."""

    def __init__(self, gap_ms=10, serial=4711, limit_s=60):
        super().__init__(limit_s)
        program("qemu-system-arm")
        elf = image("cart_f405")
        data = os.path.join(self.folder.name, "board.bin")
        with open(data, "wb") as out:
            out.write(struct.pack("<II", serial, int(gap_ms * 62500)))
        self.start(realtime() + ["qemu-system-arm", "-M", "netduinoplus2", "-kernel", elf, "-display", "none",
                    "-monitor", "none", "-device", f"loader,file={data},addr=0x0800c000,force-raw=on",
                    "-chardev", "pty,id=line", "-serial", "chardev:line"], r"(/dev/pts/\d+)")


class Native(Bench):
    """The firmware on its simulated port, as a program of the host."""

    def __init__(self, binary, limit_s=60, options=()):
        super().__init__(limit_s)
        if not os.path.exists(binary):
            skip("no " + binary)
        self.start([binary, *options], r"(/dev/pts/\d+)")

    def console(self, letter):
        self.process.stdin.write(letter.encode())
        self.process.stdin.flush()
        answer = self.process.stdout.read(1).decode()
        assert answer == letter, answer


def crc(frame):
    value = 0xFFFF
    for byte in frame:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return bytes([value & 0xFF, value >> 8])


class Line:
    """Raw bytes on a bench's line, for frames that no well-behaved master sends."""

    def __init__(self, device):
        self.fd = os.open(device, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        termios.tcflush(self.fd, termios.TCIOFLUSH)

    def send(self, data):
        os.write(self.fd, data)

    def receive(self, first_s, gap_s=0.03):
        """All that comes until the line is quiet; waits first_s for the first byte."""
        import select
        data = b""
        while select.select([self.fd], [], [], gap_s if data else first_s)[0]:
            data += os.read(self.fd, 512)
        return data

    def close(self):
        os.close(self.fd)
