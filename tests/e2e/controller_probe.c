/* libmodbus against a controller: each function that it has, once, with the values checked.
 * Usage: controller_probe DEVICE; prints "FUNCTION ok" or "FUNCTION what went wrong" a line. */
#include "firmware/shared/regmap.h"

#include <errno.h>
#include <modbus/modbus.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

/* Repeats a call that got no answer, as masters of an emulated line must. */
#define TRY(call)                                                                                  \
    __extension__({                                                                                \
        int try_result = -1;                                                                       \
        errno = ETIMEDOUT;                                                                         \
        for (int n = 0; n < 5 && try_result < 0 && errno == ETIMEDOUT; n++)                        \
            try_result = (call);                                                                   \
        try_result;                                                                                \
    })

static int failures;

static void report(int function, bool good) {
    if (good) {
        (void)printf("%d ok\n", function);
        return;
    }
    failures++;
    (void)printf("%d %s\n", function, errno ? modbus_strerror(errno) : "wrong value");
}

static void probe_bits(modbus_t *m) {
    uint8_t bits[REGMAP_DISCRETE_COUNT_], coils[REGMAP_COIL_COUNT_];
    const uint8_t off[2] = {0, 0};
    report(2, TRY(modbus_read_input_bits(m, 0, REGMAP_DISCRETE_COUNT_, bits)) ==
                      REGMAP_DISCRETE_COUNT_ &&
                  bits[REGMAP_DISCRETE_estop_closed] && !bits[REGMAP_DISCRETE_laser_on]);
    bool on = TRY(modbus_write_bit(m, REGMAP_COIL_motor_enable, 1)) == 1;
    bool read = TRY(modbus_read_bits(m, 0, REGMAP_COIL_COUNT_, coils)) == REGMAP_COIL_COUNT_;
    report(5, on);
    report(1, read && coils[REGMAP_COIL_motor_enable] && !coils[REGMAP_COIL_laser_enable]);
    report(15, TRY(modbus_write_bits(m, REGMAP_COIL_motor_enable, 2, off)) == 2 &&
                   TRY(modbus_read_bits(m, 0, 1, coils)) == 1 && !coils[0]);
}

static void probe_words(modbus_t *m) {
    uint16_t w[16], out[4] = {0, 0, 0, 0};
    report(4, TRY(modbus_read_input_registers(m, REGMAP_ADDR_map_version, 14, w)) == 14 &&
                  regmap_get_map_version(w, 0) == REGMAP_VERSION && regmap_get_uptime_us(w, 0));
    report(6, TRY(modbus_write_register(m, REGMAP_ADDR_scan_steps, 0x0123)) == 1);
    report(3, TRY(modbus_read_registers(m, REGMAP_ADDR_scan_from, 8, w)) == 8 &&
                  regmap_get_scan_steps(w, REGMAP_ADDR_scan_from) == 0x0123);
    regmap_put_scan_from(out, REGMAP_ADDR_scan_from, -12345);
    regmap_put_scan_to(out, REGMAP_ADDR_scan_from, 23456);
    bool written = TRY(modbus_write_registers(m, REGMAP_ADDR_scan_from, 4, out)) == 4;
    report(16, written && TRY(modbus_read_registers(m, REGMAP_ADDR_scan_from, 4, w)) == 4 &&
                   !memcmp(w, out, sizeof out));
    /* (0x0123 and 0x00f2) or (0x0005 and not 0x00f2) */
    bool masked = TRY(modbus_mask_write_register(m, REGMAP_ADDR_scan_steps, 0x00f2, 0x0005)) >= 0;
    report(22, masked && TRY(modbus_read_registers(m, REGMAP_ADDR_scan_steps, 1, w)) == 1 &&
                   w[0] == 0x0027);
    regmap_put_scan_to(out, REGMAP_ADDR_scan_from, -1);
    report(23, TRY(modbus_write_and_read_registers(m, REGMAP_ADDR_scan_from, 4, out,
                                                   REGMAP_ADDR_scan_from, 8, w)) == 8 &&
                   regmap_get_scan_to(w, REGMAP_ADDR_scan_from) == -1);
}

int main(int argc, char **argv) {
    modbus_t *m = argc == 2 ? modbus_new_rtu(argv[1], 115200, 'N', 8, 1) : NULL;
    if (!m || modbus_set_slave(m, 1) || modbus_set_response_timeout(m, 1, 0) || modbus_connect(m)) {
        (void)fprintf(stderr, "controller_probe: %s\n",
                      argc == 2 ? modbus_strerror(errno) : "usage: controller_probe DEVICE");
        return 2;
    }
    probe_bits(m);
    probe_words(m);
    modbus_close(m);
    modbus_free(m);
    return failures != 0;
}
