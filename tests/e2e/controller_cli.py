#!/usr/bin/python3
"""`scancart controller` as a technician uses it, against a bench: controller_cli.py sim|qemu"""
import fcntl
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import threading
import time
import tty

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from controller_bench import Line, Mps2, Native, crc  # noqa: E402

BIN = os.environ["SCANCART_BIN"]
HOST_TIMEOUT_MS, MIRROR_TARGET, MOTOR_ENABLE = 0x1001, 0x1002, 0


def command(action, device, *options):
    return [BIN, "controller", action, "--port", device, *options]


def run(action, device, *options, status=0, **more):
    result = subprocess.run(command(action, device, *options), capture_output=True, text=True, timeout=60, **more)
    assert result.returncode == status, (action, options, result)
    if status:
        assert result.stderr.count("\n") == 1 and not result.stdout, result  # one line that says it all
        return result.stderr
    return result.stdout


def status_of(bench):
    return json.loads(run("status", bench.device, "--json"))


def write_register(bench, address, value):
    raw(bench, bytes([1, 6]) + address.to_bytes(2, "big") + value.to_bytes(2, "big"))


def raw(bench, frame):
    line = Line(bench.device)
    line.send(frame + crc(frame))
    answer = line.receive(2.0)
    line.close()
    assert answer[:2] == frame[:2], answer


# --- with a controller ---------------------------------------------------------------------------------

def status_says_who_and_what(bench):
    text = run("status", bench.device)
    assert "controller " + bench.board in text and "state      idle; motors off, laser off" in text, text
    report = status_of(bench)
    assert report["board"] == bench.board and report["state"] == "idle" and report["fault"]["code"] == 0
    assert report["temperature_c"] == 25 and not report["causes_present"]


def refuses_to_move_before_homing(bench):
    assert "home` first" in run("move", bench.device, "--pan", "0", status=1)
    assert not status_of(bench)["motors_on"]


def homes_both_axes_and_switches_motors_off(bench):
    report = json.loads(run("home", bench.device, "--json"))
    assert report["pan"]["homed"] and report["tilt"]["homed"], report
    assert not status_of(bench)["motors_on"]


def moves_to_the_very_step(bench):
    report = json.loads(run("move", bench.device, "--pan", "-13000", "--tilt", "-3000", "--json"))
    assert report["pan"]["steps"] == -13000 and report["tilt"]["steps"] == -3000, report


def refuses_targets_outside_the_limits(bench):
    assert "out of range" in run("move", bench.device, "--pan", "999999", status=1)
    assert status_of(bench)["pan"]["steps"] == -13000


def names_the_fault_and_what_to_do(bench):
    bench.console("e")
    text = run("status", bench.device)
    assert "emergency stop pressed" in text and "Release the emergency stop" in text, text
    assert "emergency stop OPEN" in text
    assert "Release the emergency stop" in run("home", bench.device, status=1)
    assert "still present: emergency stop pressed" in run("clear", bench.device, status=1)
    bench.console("E")
    assert run("clear", bench.device) == "cleared: emergency stop pressed\n"
    assert run("clear", bench.device) == "no fault to clear\n"


def stores_commissioning_values(bench):
    assert run("save", bench.device) == "commissioning values stored\n"
    assert status_of(bench)["commission_state"] == 1


def ctrl_c_stops_the_motion(bench):
    with subprocess.Popen(command("move", bench.device, "--pan", "5000"), stderr=subprocess.PIPE,
                          text=True) as moving:
        time.sleep(1)
        moving.send_signal(signal.SIGINT)
        said = moving.communicate(timeout=20)[1]
    assert moving.returncode == 1 and "stopped at pan" in said, said
    report = status_of(bench)
    assert -13000 < report["pan"]["steps"] < 5000 and not report["motors_on"] and not report["pan"]["moving"]
    assert report["state"] == "idle" and report["pan"]["homed"]  # it ramped down: no step is lost


def killed_program_leaves_a_safe_cart(bench):
    with subprocess.Popen(command("move", bench.device, "--pan", "9000")) as moving:
        time.sleep(1)
        moving.kill()
    time.sleep(bench.patience_s)  # the program had asked for 2 s; asking now would feed the watchdog
    report = status_of(bench)
    assert report["fault"]["name"] == "HOST_SILENT" and not report["motors_on"], report
    run("clear", bench.device)


def monitor_counts_index_events_without_a_loss(bench):
    write_register(bench, HOST_TIMEOUT_MS, 5000)
    raw(bench, bytes([1, 5, 0, MOTOR_ENABLE, 0xFF, 0]))
    write_register(bench, MIRROR_TARGET, 8000)
    out = run("monitor", bench.device, "-n", "8", "-i", "0.3", "--json")
    decoder, reports, at = json.JSONDecoder(), [], 0
    while at < len(out.rstrip()):
        report, end = decoder.raw_decode(out, at)
        reports.append(report)
        at = end + 1
    assert len(reports) == 8
    first, last = reports[0], reports[-1]
    assert last["lost_events"] == 0 and last["index_events"] >= 3, last
    assert last["events_next"] - first["events_next"] == last["index_events"] - first["index_events"]
    assert last["mirror_rev_s"] > 1, last
    write_register(bench, MIRROR_TARGET, 0)
    raw(bench, bytes([1, 5, 0, MOTOR_ENABLE, 0, 0]))


def hung_main_loop_ends_in_a_reset_and_is_reported(bench):
    bench.console("x")
    time.sleep(bench.patience_s)
    report = status_of(bench)
    assert report["reset_cause"] == "watchdog" and report["fault"]["name"] == "WATCHDOG", report
    assert not report["motors_on"] and not report["pan"]["homed"]
    run("clear", bench.device)
    assert status_of(bench)["state"] == "idle"


# --- lines that do not work ----------------------------------------------------------------------------

def names_a_device_that_is_not_there(_):
    assert "no device /dev/nowhere" in run("status", "/dev/nowhere", status=1)
    assert "is not a serial line" in run("status", "/dev/null", status=1)


def names_the_udev_rule_when_not_allowed(bench):
    if os.getuid() != 0:
        return  # only root can become somebody else
    def nobody():
        os.setgroups([])
        os.setgid(65534)
        os.setuid(65534)
    os.chmod(bench.device, 0o600)
    os.chmod(bench.folder.name, 0o755)
    program = shutil.copy(BIN, bench.folder.name)  # nobody may not be allowed where BIN is
    result = subprocess.run([program, "controller", "status", "--port", bench.device], capture_output=True,
                            text=True, timeout=20, preexec_fn=nobody, cwd="/", check=False)
    assert result.returncode == 1 and "udev rules" in result.stderr and "group scancart" in result.stderr, result


def names_a_port_in_use(bench):
    holder = os.open(bench.device, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    assert "in use by another program" in run("status", bench.device, status=1)
    os.close(holder)


def says_when_nobody_answers(bench):
    assert "no answer on" in run("status", bench.device, "--unit", "9", "--timeout", "200", status=1)


class Impostor:
    """A device that answers each request with the same PDU."""

    def __init__(self, pdu):
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.device, self.pdu, self.slave = os.ttyname(slave), pdu, slave
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        try:
            while os.read(self.master, 256):
                os.write(self.master, bytes([1]) + self.pdu + crc(bytes([1]) + self.pdu))
        except OSError:
            pass


class SlowSlave:
    """Answers reads with zeros (register 0: the map's version); the first answer comes too late."""

    def __init__(self, late_s):
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.device, self.late_s, self.requests = os.ttyname(self.slave), late_s, 0
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        waiting = b""
        while True:
            waiting += os.read(self.master, 256)
            while len(waiting) >= 8:  # all that is asked here has 8 bytes
                request, waiting = waiting[:8], waiting[8:]
                self.requests += 1
                time.sleep(self.late_s if self.requests == 1 else 0.005)
                size = 2 * request[5] if request[1] == 3 else (request[5] + 7) // 8
                data = bytearray(size)
                if request[1] == 3 and request[2:4] == bytes(2):
                    data[1] = 1
                reply = bytes([1, request[1], size]) + data
                os.write(self.master, reply + crc(reply))


def late_answers_are_not_taken_for_the_next(_):
    slow = SlowSlave(late_s=0.3)
    run("status", slow.device, "--timeout", "200")
    assert slow.requests == 9, slow.requests  # identity, its repetition, seven of the status


def tells_other_devices_from_a_controller(_):
    other = Impostor(bytes([0x83, 2]))
    assert "no scancart controller" in run("status", other.device, status=1)
    newer = Impostor(bytes([3, 28, 0, 99]) + bytes(26))
    text = run("status", newer.device, status=1)
    assert "register map 99" in text and "update" in text, text
    noise = Impostor(bytes([3, 1, 0]))
    assert "garbled" in run("status", noise.device, "--timeout", "200", status=1)


def usage_errors_are_status_2(bench):
    run_2 = [[BIN, "controller"], [BIN, "controller", "status"], [BIN, "controller", "dance", "--port", "x"],
             command("move", bench.device), command("status", bench.device, "more"),
             command("home", bench.device, "--axis", "roll")]
    for arguments in run_2:
        result = subprocess.run(arguments, capture_output=True, text=True, timeout=20, check=False)
        assert result.returncode == 2 and result.stderr.count("\n") == 1, result


def board_file_gives_the_line(bench):
    path = os.path.join(bench.folder.name, "board.yaml")
    with open(path, "w", encoding="utf-8") as out:
        out.write(f"name: bench\ncontroller: {{device: {bench.device}, parity: none, unit: 1}}\n")
    result = subprocess.run([BIN, "controller", "status", "--board", path], capture_output=True, text=True,
                            timeout=20, check=False)
    assert result.returncode == 0 and bench.board in result.stdout, result
    with open(path, "a", encoding="utf-8") as out:
        out.write("gpio: {chip: x, colour: red}\n")
    result = subprocess.run([BIN, "controller", "status", "--board", path], capture_output=True, text=True,
                            timeout=20, check=False)
    assert result.returncode == 1 and "no such key 'colour'" in result.stderr, result


WITH_CONTROLLER = [status_says_who_and_what, refuses_to_move_before_homing, homes_both_axes_and_switches_motors_off,
                   moves_to_the_very_step, refuses_targets_outside_the_limits, names_the_fault_and_what_to_do,
                   stores_commissioning_values, ctrl_c_stops_the_motion, killed_program_leaves_a_safe_cart,
                   monitor_counts_index_events_without_a_loss]
OF_THE_LINE = [names_a_device_that_is_not_there, names_the_udev_rule_when_not_allowed, names_a_port_in_use,
               says_when_nobody_answers, late_answers_are_not_taken_for_the_next,
               tells_other_devices_from_a_controller, usage_errors_are_status_2,
               board_file_gives_the_line]


def main():
    kind = sys.argv[1]
    bench = Mps2() if kind == "qemu" else Native(os.environ["SCANCART_BUILD"] + "/tests/controller_sim")
    bench.board = "qemu_mps2" if kind == "qemu" else "simulated"
    bench.patience_s = 8 if kind == "qemu" else 3.5  # an emulator's time may run slower than ours
    with bench:
        more = OF_THE_LINE if kind == "sim" else [hung_main_loop_ends_in_a_reset_and_is_reported]
        for claim in WITH_CONTROLLER + more:
            begun = time.monotonic()
            claim(bench)
            print(f"ok   {claim.__name__} ({time.monotonic() - begun:.1f} s)", flush=True)


main()
