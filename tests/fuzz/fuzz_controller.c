/* The controller behind the frame path: bytes from a serial line into the whole firmware on the
 * simulated cart. Input: chunks of one length byte and up to 127 bytes. Bit 7 of the length: the
 * chunk is a frame's beginning and gets a good CRC; otherwise it goes out as it is. After each
 * chunk the line is silent for a frame gap. A chunk of length 0 lets 20 ms pass. Whatever comes,
 * the state stays valid. */
#include "firmware/core/firmware.h"
#include "firmware/port/sim/sim.h"
#include "firmware/shared/mbframe.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool condition) {
    if (!condition)
        abort();
}

static void check_registers(const struct firmware *fw) {
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++) {
        const struct regmap_entry *entry = &regmap_holdings[i];
        int64_t value = regmap_value(entry, &fw->holding);
        bool key = i == REGMAP_HOLDING_fault_clear || i == REGMAP_HOLDING_commission_save;
        require(key ? value == 0 : value >= entry->min && value <= entry->max);
    }
    require(fw->holding.mirror_safe < fw->holding.mirror_max);
}

static void check_safety(const struct sim *sim, const struct firmware *fw) {
    struct sim_truth truth = sim_truth(sim);
    enum ctlstate state = fw->estop.state;
    require(truth.laser == (state == CTLSTATE_LASER));
    require(truth.motors == (state == CTLSTATE_READY || state == CTLSTATE_LASER));
    require((state == CTLSTATE_FAULT) == (fw->estop.fault != FAULT_NONE));
    if (!truth.motors)
        require(!fw->axis[HAL_PAN].active && !fw->axis[HAL_TILT].active && !fw->mirror.drive);
    if (truth.laser)
        require(fw->commissioned && fw->mirror.in_range);
}

/* Whole frames with good CRC from this unit, or nothing. */
static void check_replies(struct sim *sim) {
    uint8_t reply[1024];
    size_t count = sim_collect(sim, reply, sizeof reply);
    if (count)
        require(count <= MBFRAME_MAX && mbframe_ok(reply, (unsigned)count) && reply[0] != 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    config.poll_us = 500;
    config.flash_us = 1000;
    struct sim *sim = sim_create(&config);
    if (!sim)
        return 0;
    for (size_t at = 0; at < size && sim_now_us(sim) < 500000;) {
        size_t length = data[at] & 0x7fu;
        bool seal = (data[at] & 0x80u) != 0;
        at++;
        length = length < size - at ? length : size - at;
        uint8_t frame[130];
        memcpy(frame, data + at, length);
        at += length;
        if (!length)
            sim_advance(sim, 20000);
        (void)sim_send(sim, frame, seal ? mbframe_seal(frame, (unsigned)length) : length);
        sim_advance(sim, 3000);
        check_replies(sim);
        check_registers(sim_firmware(sim));
        check_safety(sim, sim_firmware(sim));
    }
    sim_destroy(sim);
    return 0;
}
