#!/usr/bin/python3
"""The cart's own image boots in QEMU's STM32F405 machine and answers Modbus. Clocks and pins are stubs there:
the image must find that out, keep laser and motors off, and say so."""
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from controller_bench import F405, Line, crc  # noqa: E402

ESTOP, INTERLOCK, DOOR, TEMP_SENSOR, CLOCK = 1, 2, 3, 5, 13


def ask(line, *body):
    for _ in range(10):
        line.send(bytes(body) + crc(bytes(body)))
        answer = line.receive(1.0)
        if len(answer) > 4 and crc(answer[:-2]) == answer[-2:]:
            return answer
    raise AssertionError("no answer")


def words(line, address, count):
    answer = ask(line, 1, 3, address >> 8, address & 0xFF, 0, count)
    assert answer[:3] == bytes([1, 3, 2 * count]), answer.hex()
    return [answer[3 + 2 * i] << 8 | answer[4 + 2 * i] for i in range(count)]


def main():
    with F405(serial=4711) as bench:
        line = Line(bench.device)
        identity = words(line, 0, 14)
        assert identity[0] == 1 and identity[3] == 1 and identity[5] == 4711, identity
        state, fault = words(line, 0x10, 2)
        high, low = words(line, 0x1C, 2)
        present = high << 16 | low
        assert state == 3 and fault, (state, fault)
        for condition in (ESTOP, INTERLOCK, DOOR, TEMP_SENSOR, CLOCK):
            assert present >> condition & 1, (condition, hex(present))
        outputs = ask(line, 1, 2, 0, 11, 0, 2)
        assert outputs[3] == 0, "motors or laser on"
        assert ask(line, 1, 5, 0, 1, 0xFF, 0)[1:3] == bytes([0x85, 4])  # laser enable: refused, faulted
        assert ask(line, 1, 6, 0x10, 0x27, 0, 9)[1] == 6 and words(line, 0x1027, 1) == [9]
        free = words(line, 0x6A, 1)[0]
        line.close()
    print(f"cart_f405 answers; it reports the missing crystal and open chains, all is off; {free} bytes of stack unused")


main()
