#!/usr/bin/python3
"""Modbus masters that nobody here wrote, and frames that no master sends, against the controller's image in
QEMU. The tables in docs/controller-interop.md are what this saw: with --write they are written, else
compared.

Usage: controller_interop.py PROBE [--write]     PROBE: the built controller_probe (libmodbus)
"""
import difflib
import os
import re
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from controller_bench import ROOT, Line, Mps2, crc, program, skip  # noqa: E402

try:
    import pymodbus
    from pymodbus.client import ModbusSerialClient
    from pymodbus.mei_message import ReadDeviceInformationRequest
    from pymodbus.pdu import ExceptionResponse
except ImportError:
    skip("no pymodbus; install scripts/packages-test.txt")

GAP_US = 10000
TRIES = 5
DOCUMENT = os.path.join(ROOT, "docs/controller-interop.md")
FUNCTIONS = {1: "read coils", 2: "read discrete inputs", 3: "read holding registers", 4: "read input registers",
             5: "write one coil", 6: "write one register", 15: "write coils", 16: "write registers",
             22: "mask write", 23: "write and read", 43: "device identification (43/14)"}
SCAN_FROM, SCAN_STEPS, FAULT_CLEAR, PAN_TARGET = 0x1020, 0x1027, 0x1000, 0x1010


# --- masters -----------------------------------------------------------------------------------------------

def with_libmodbus(bench, probe):
    out = subprocess.run([probe, bench.device], capture_output=True, text=True, timeout=60, check=False).stdout
    return {int(line.split()[0]): line.split(" ", 1)[1] == "ok" for line in out.splitlines()}


def mbpoll(bench, kind, at, *values, count=1):
    """Values read, or True for a write that was acknowledged."""
    command = [program("mbpoll"), "-m", "rtu", "-a", "1", "-b", "115200", "-P", "none", "-0", "-1", "-B", "-q",
               "-o", "1", "-t", kind, "-r", str(at)]
    command += [bench.device, "--", *map(str, values)] if values else ["-c", str(count), bench.device]
    for _ in range(TRIES):
        result = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
        if "timed out" not in result.stdout + result.stderr:
            break
    if values:
        return f"Written {len(values)} references" in result.stdout
    return [int(v) for v in re.findall(r"^\[\d+\]:\s+(-?\d+)", result.stdout, re.M)]


def with_mbpoll(bench):
    seen = {}
    discrete = mbpoll(bench, "1", 0, count=20)
    seen[2] = len(discrete) == 20 and discrete[0] == 1 and discrete[12] == 0
    seen[5] = mbpoll(bench, "0", 0, 1)
    seen[1] = mbpoll(bench, "0", 0, count=8) == [1, 0, 0, 0, 0, 0, 0, 0]
    seen[15] = mbpoll(bench, "0", 0, 0, 0) and mbpoll(bench, "0", 0, count=1) == [0]
    seen[4] = mbpoll(bench, "3", 0, count=4) == [1, 1, 0, 2] and mbpoll(bench, "3:int", 4) == [386]
    seen[6] = mbpoll(bench, "4", SCAN_STEPS, 77)
    seen[3] = mbpoll(bench, "4", SCAN_STEPS) == [77]
    seen[16] = (mbpoll(bench, "4:int", SCAN_FROM, -5000, 6000) and
                mbpoll(bench, "4:int", SCAN_FROM, count=2) == [-5000, 6000])
    return seen


def with_pymodbus(bench):
    client = ModbusSerialClient(bench.device, baudrate=115200, parity="N", timeout=1)
    assert client.connect()

    def ask(call, *arguments, **more):
        for _ in range(TRIES):
            answer = call(*arguments, **more)
            if not answer.isError() or isinstance(answer, ExceptionResponse):
                return answer
        return answer

    seen = {}
    bits = ask(client.read_discrete_inputs, 0, 20, slave=1)
    seen[2] = not bits.isError() and bits.bits[0] and not bits.bits[12]
    seen[5] = not ask(client.write_coil, 0, True, slave=1).isError()
    bits = ask(client.read_coils, 0, 8, slave=1)
    seen[1] = not bits.isError() and bits.bits[:8] == [True] + 7 * [False]
    seen[15] = (not ask(client.write_coils, 0, [False, False], slave=1).isError() and
                not ask(client.read_coils, 0, 1, slave=1).bits[0])
    words = ask(client.read_input_registers, 0, 6, slave=1)
    seen[4] = not words.isError() and words.registers == [1, 1, 0, 2, 0, 386]
    seen[6] = not ask(client.write_register, SCAN_STEPS, 99, slave=1).isError()
    words = ask(client.read_holding_registers, SCAN_STEPS, 1, slave=1)
    seen[3] = not words.isError() and words.registers == [99]
    values = [0xFFFF, 0x8000, 0x0001, 0x0002]
    seen[16] = (not ask(client.write_registers, SCAN_FROM, values, slave=1).isError() and
                ask(client.read_holding_registers, SCAN_FROM, 4, slave=1).registers == values)
    mask = ask(client.mask_write_register, address=SCAN_STEPS, and_mask=0x00F0, or_mask=0x0005, unit=1)
    seen[22] = not mask.isError() and ask(client.read_holding_registers, SCAN_STEPS, 1, slave=1).registers == [0x65]
    both = ask(client.readwrite_registers, read_address=SCAN_FROM, read_count=4, write_address=SCAN_FROM,
               write_registers=[0, 1, 0, 2], unit=1)
    seen[23] = not both.isError() and both.registers == [0, 1, 0, 2]
    who = ask(client.execute, ReadDeviceInformationRequest(read_code=1, object_id=0, unit=1))
    seen[43] = not who.isError() and who.information.get(0) == b"scancart"
    client.close()
    return seen


# --- frames ------------------------------------------------------------------------------------------------

def sealed(*body):
    return bytes(body) + crc(bytes(body))


READ = sealed(1, 3, 0x10, 0x27, 0, 1)           # scan_steps
READ_LONG = sealed(1, 3, 0x10, 0x27, 0, 1, 0)   # one byte too many, under a good CRC
WRITE_77 = sealed(1, 6, 0x10, 0x27, 0, 77)


def write_words(start, words, size=None):
    data = b"".join(w.to_bytes(2, "big") for w in words)
    head = bytes([1, 16]) + start.to_bytes(2, "big") + len(words).to_bytes(2, "big")
    return sealed(*head, len(data) if size is None else size, *data)


def broken(frame):
    return frame[:3] + bytes([frame[3] ^ 0x10]) + frame[4:]


PAUSE = None  # in a list of pieces: longer than the end-of-frame gap
# (what is sent, what the specification asks for, pieces, what must come: an exception code, "answer" or "silence")
FRAMES = [
    ("good request", "the answer", [READ], "answer"),
    ("one bit changed: bad CRC", "silence", [broken(READ)], "silence"),
    ("shorter than a frame (3 bytes)", "silence", [READ[:3]], "silence"),
    ("cut in the middle", "silence", [READ[:5]], "silence"),
    ("one byte too many under a good CRC", "exception 03", [READ_LONG], 3),
    ("byte count that does not fit the quantity", "exception 03", [write_words(SCAN_FROM, [0, 1], size=2)], 3),
    ("unknown function (65)", "exception 01", [sealed(1, 65, 0, 0)], 1),
    ("function above 127 (131)", "exception 01", [sealed(1, 131, 2)], 1),
    ("encapsulated interface other than 14 (43/13)", "exception 01", [sealed(1, 43, 13, 0, 0)], 1),
    ("quantity 0", "exception 03", [sealed(1, 3, 0x10, 0x20, 0, 0)], 3),
    ("quantity 126", "exception 03", [sealed(1, 3, 0x10, 0x20, 0, 126)], 3),
    ("address without a register", "exception 02", [sealed(1, 3, 0x0F, 0, 0, 1)], 2),
    ("block that runs past the last register", "exception 02", [sealed(1, 4, 0, 0x6A, 0, 2)], 2),
    ("coil value neither 0000 nor FF00", "exception 03", [sealed(1, 5, 0, 6, 0x12, 0x34)], 3),
    ("write to a read-only register", "exception 02", [sealed(1, 6, 0, 0, 0, 1)], 2),
    ("value out of its range", "exception 03", [sealed(1, 6, 0x10, 0x27, 0x03, 0xE9)], 3),
    ("block write with one value out of range", "exception 03, nothing is written",
     [write_words(SCAN_FROM, [0, 5, 0, 6, 0, 0, 0, 4])], 3),
    ("frame split by a pause longer than the gap", "silence", [READ[:4], PAUSE, READ[4:]], "silence"),
    ("two frames without a gap", "silence", [READ + READ], "silence"),
    ("over-long (300 bytes)", "silence", [bytes(300)], "silence"),
    ("over-long with a good frame at its end", "silence", [bytes(300) + READ], "silence"),
    ("noise directly before a frame", "silence", [b"\x5a\xa5" + READ], "silence"),
    ("noise, a pause, a frame", "the answer", [b"\x5a\xa5", PAUSE, READ], "answer"),
    ("another unit's address", "silence", [sealed(9, 3, 0x10, 0x27, 0, 1)], "silence"),
    ("reserved address (250)", "silence", [sealed(250, 3, 0x10, 0x27, 0, 1)], "silence"),
    ("broadcast read", "silence", [sealed(0, 3, 0x10, 0x27, 0, 1)], "silence"),
    ("broadcast write", "silence, and it is carried out", [sealed(0, 6, 0x10, 0x27, 0, 88)], "silence"),
]


def send(line, pieces):
    for piece in pieces:
        if piece is PAUSE:
            time.sleep(0.15)
        else:
            line.send(piece)


def exchange(line, pieces, first_s):
    send(line, pieces)
    answer = line.receive(first_s)
    time.sleep(0.03)
    return answer


def read_word(line, address):
    for _ in range(TRIES):
        answer = exchange(line, [sealed(1, 3, address >> 8, address & 0xFF, 0, 1)], 1.0)
        if len(answer) == 7 and answer[:3] == b"\x01\x03\x02" and crc(answer[:5]) == answer[5:]:
            return answer[3] << 8 | answer[4]
    raise AssertionError(f"no answer to a good request: {answer.hex()}")


def classify(answer):
    if not answer:
        return "silence"
    assert crc(answer[:-2]) == answer[-2:] and answer[0] == 1, answer.hex()
    return answer[2] if answer[1] & 0x80 and len(answer) == 5 else "answer"


def try_frame(line, pieces, wanted):
    """What came; if an answer was to come and did not, again: the emulator may have been stopped meanwhile."""
    for _ in range(TRIES if wanted != "silence" else 1):
        came = classify(exchange(line, pieces, 0.15 if wanted == "silence" else 1.0))
        if came != "silence":
            break
    return came


def frames(bench):
    """Each row: what was sent, asked for, seen; afterwards the registers are what they should be."""
    line, rows = Line(bench.device), []
    exchange(line, [write_words(SCAN_FROM, [0, 1, 0, 2])], 1.0)
    for what, asked, pieces, wanted in FRAMES:
        exchange(line, [WRITE_77], 1.0)
        assert read_word(line, SCAN_STEPS) == 77
        came = try_frame(line, pieces, wanted)
        value = read_word(line, SCAN_STEPS)  # still answers
        done = value == (88 if what == "broadcast write" else 77) and read_word(line, SCAN_FROM + 1) == 1
        seen = came if isinstance(came, str) else f"exception {came:02d}"
        rows.append((what, asked, {"answer": "the answer"}.get(seen, seen), came == wanted and done))
    rows += while_faulted(bench, line)
    line.close()
    return rows


def while_faulted(bench, line):
    bench.console("e")
    move = write_words(PAN_TARGET, [0, 1])
    rows = []
    for what, pieces, wanted in (("command while a fault is latched", [move], 4),
                                 ("clear with another fault's code", [sealed(1, 6, 0x10, 0, 0, 2)], 3),
                                 ("clear while the cause is present", [sealed(1, 6, 0x10, 0, 0, 1)], 4)):
        came = try_frame(line, pieces, wanted)
        kept = read_word(line, 0x0011) == 1
        rows.append((what, f"exception {wanted:02d}, the fault stays", f"exception {came:02d}", came == wanted and kept))
    bench.console("E")
    came = try_frame(line, [sealed(1, 6, 0x10, 0, 0, 1)], "answer")
    rows.append(("clear after the cause has gone", "the answer", "the answer" if came == "answer" else str(came),
                 came == "answer" and read_word(line, 0x0011) == 0))
    return rows


# --- the document ------------------------------------------------------------------------------------------

def version(package):
    out = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", package], capture_output=True, text=True, check=False)
    return out.stdout.split("+")[0].split("-")[0] or "?"


# Figures of one run on a machine of two processors that were busy otherwise; `scripts/bench firmware` repeats it.
ENDURANCE = """
## Endurance

100 000 requests and the reading of index events between them, 1 % with a byte changed, 1 % cut short
(`scripts/bench firmware`; a run of some thousand is a test). Every answer is compared with a model of the registers, every
event has the sequence number and the revolution that must come next. An emulator may be stopped by its host in the middle
of a frame: such a request gets no answer, is repeated, and is counted.

| controller | transactions | a second | corrupted | truncated | unanswered | wrong answers | index events | missed |
|---|---:|---:|---:|---:|---:|---:|---:|---:|
| image in QEMU, end-of-frame gap 4 ms | 106250 | 130 | 1022 | 997 | 10 | 0 | 5242 | 0 |
| native, gap not waited for | 106250 | 753 | 1016 | 1073 | 0 | 0 | 6567 | 0 |""".splitlines()


def document(masters, rows):
    names = list(masters)
    text = ["# Interoperability of the controller's Modbus line", "",
            "Made by `tests/e2e/controller_interop.py --write` from what it saw; the test of the same name compares. The",
            "slave is the image for the emulated board (QEMU, Cortex-M4F), the line a pseudo-terminal, the end-of-frame",
            f"gap {GAP_US // 1000} ms.", "", "## Masters", "",
            "Each function is carried out and its values are checked: 16-, 32- and 64-bit registers, signed ones, coils",
            "and discrete inputs. A dash: the master has no such function.", "",
            "| function | | " + " | ".join(names) + " |", "|---:|---|" + ":---:|" * len(names)]
    for number, name in FUNCTIONS.items():
        cells = ["—" if number not in masters[m] else "yes" if masters[m][number] else "**NO**" for m in names]
        text.append(f"| {number} | {name} | " + " | ".join(cells) + " |")
    text += ["", "## Frames that no good master sends", "",
             "After each of them a good request is answered and no register has changed, unless the row says so.", "",
             "| sent | the specification asks for | seen | |", "|---|---|---|---|"]
    text += [f"| {what} | {asked} | {seen} | {'ok' if good else '**NO**'} |" for what, asked, seen, good in rows]
    return "\n".join(text + ENDURANCE) + "\n"


def main():
    probe, write = sys.argv[1], "--write" in sys.argv
    with Mps2(gap_us=GAP_US, limit_s=150) as bench:
        masters = {f"libmodbus {version('libmodbus5')}": with_libmodbus(bench, probe),
                   f"mbpoll {version('mbpoll')}": with_mbpoll(bench),
                   f"pymodbus {pymodbus.__version__}": with_pymodbus(bench)}
        rows = frames(bench)
    text = document(masters, rows)
    if write:
        with open(DOCUMENT, "w", encoding="utf-8") as out:
            out.write(text)
    known = open(DOCUMENT, encoding="utf-8").read()
    if "**NO**" in text or text != known:
        sys.stdout.writelines(difflib.unified_diff(known.splitlines(True), text.splitlines(True), DOCUMENT, "seen"))
        sys.exit(1)
    print(f"{sum(len(m) for m in masters.values())} functions of {len(masters)} masters and {len(rows)} frames: "
          "as docs/controller-interop.md says")


main()
