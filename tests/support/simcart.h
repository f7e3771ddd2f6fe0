/* A simulated cart for firmware tests: the usual states in one call. */
#ifndef SC_TESTS_SIMCART_H
#define SC_TESTS_SIMCART_H

#include "firmware/core/firmware.h"
#include "firmware/port/sim/sim.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/mbframe.h"
#include "firmware/shared/regmap.h"
#include "tests/support/cmocka_all.h"

/* Bytes take no time on the line, so that a request costs one frame gap of virtual time. */
static inline struct sim_config simcart_config(void) {
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    return config;
}

/* Powered up, commissioned, host time-out 5 s. */
static inline struct sim *simcart_commissioned(const struct sim_config *config) {
    struct sim *sim = sim_create(config);
    assert_non_null(sim);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_host_timeout_ms, 5000), 0);
    return sim;
}

/* Lets time pass with a request every 0.2 s. */
static inline void simcart_wait(struct sim *sim, uint64_t us) {
    uint16_t word;
    for (uint64_t done = 0; done < us; done += 200000) {
        assert_int_equal(sim_read(sim, REGMAP_ADDR_state, 1, &word), 0);
        sim_advance(sim, us - done < 200000 ? us - done : 200000);
    }
}

static inline void simcart_settle(struct sim *sim) {
    const struct firmware *fw = sim_firmware(sim);
    for (int i = 0; fw->axis[HAL_PAN].active || fw->axis[HAL_TILT].active; i++) {
        assert_true(i < 2000);
        simcart_wait(sim, 50000);
    }
}

/* Motors on, mirror at 4 rev/s and in range. */
static inline void simcart_spin(struct sim *sim) {
    const struct firmware *fw = sim_firmware(sim);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 4000), 0);
    for (int i = 0; !fw->mirror.in_range; i++) {
        assert_true(i < 100);
        simcart_wait(sim, 100000);
    }
}

/* And the laser. */
static inline void simcart_light(struct sim *sim) {
    simcart_spin(sim);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_laser_enable, true), 0);
    assert_true(sim_truth(sim).laser);
}

/* One word by function 3. */
static inline uint16_t simcart_get(struct sim *sim, uint16_t address) {
    uint16_t word = 0xffff;
    assert_int_equal(sim_read(sim, address, 1, &word), 0);
    return word;
}

static inline uint32_t simcart_get32(struct sim *sim, uint16_t address) {
    uint16_t words[2] = {0};
    assert_int_equal(sim_read(sim, address, 2, words), 0);
    return regmap_load_U32(words);
}

#endif
