/* The commissioning record in two flash sectors of 16 KiB. A write erases and fills the sector that
 * does not hold the newest record and commits it by its last word: a power cut leaves the old or
 * the new one. */
#include "firmware/hal/hal_flash.h"
#include "firmware/hal/hal_safety.h"
#include "firmware/port/stm32f4/stm32f4.h"

#include <string.h>

struct record {
    uint8_t bytes[HAL_FLASH_SIZE];
    uint32_t sequence;
    uint32_t commit; /* ~sequence, written last */
};

enum { BUSY_TRIES = 100000000 }; /* some seconds at 168 MHz; a sector erase takes 0.8 s at most */

static const struct record *record_a(void) {
    return (const struct record *)BOARD_RECORD_A_ADDRESS;
}
static const struct record *record_b(void) {
    return (const struct record *)BOARD_RECORD_B_ADDRESS;
}

static bool valid(const struct record *record) {
    return record->sequence != 0xffffffffu && record->commit == ~record->sequence;
}

/* The record that counts, NULL if neither sector has one. */
static const struct record *newest(void) {
    bool a = valid(record_a()), b = valid(record_b());
    if (a && b)
        return (int32_t)(record_a()->sequence - record_b()->sequence) > 0 ? record_a() : record_b();
    return a ? record_a() : b ? record_b() : NULL;
}

void hal_flash_read(uint8_t *out_bytes, unsigned count) {
    const struct record *record = newest();
    if (record)
        memcpy(out_bytes, record->bytes, count);
    else
        memset(out_bytes, 0xff, count);
}

/* True when the flash has finished without an error. While it works, fetches from flash stall the
 * core. */
static bool finished(void) {
    unsigned tries = 0;
    while (FLASH->SR & FLASH_SR_BSY)
        if (++tries == BUSY_TRIES)
            return false;
    hal_safety_watchdog_kick();
    bool good = !(FLASH->SR & FLASH_SR_ERRORS);
    FLASH->SR = FLASH_SR_ERRORS; /* written 1 clears */
    return good;
}

static bool erase(uint32_t sector) {
    FLASH->CR = FLASH_CR_SER | sector << FLASH_CR_SNB_SHIFT | FLASH_CR_PSIZE_32;
    FLASH->CR |= FLASH_CR_STRT;
    bool good = finished();
    FLASH->ACR &= ~FLASH_ACR_DCEN; /* what the data cache holds of the sector is out of date */
    FLASH->ACR |= FLASH_ACR_DCRST;
    FLASH->ACR &= ~FLASH_ACR_DCRST;
    FLASH->ACR |= FLASH_ACR_DCEN;
    return good;
}

static bool program(uint32_t address, const uint32_t *words, unsigned count) {
    FLASH->CR = FLASH_CR_PG | FLASH_CR_PSIZE_32;
    for (unsigned i = 0; i < count; i++) {
        CORTEXM_REG(address + i * 4) = words[i];
        cortexm_barrier();
        if (!finished())
            return false;
    }
    return true;
}

bool hal_flash_write(const uint8_t *bytes, unsigned count) {
    const struct record *old = newest();
    bool to_b = old == record_a();
    uint32_t address = to_b ? BOARD_RECORD_B_ADDRESS : BOARD_RECORD_A_ADDRESS;
    union {
        struct record record;
        uint32_t words[sizeof(struct record) / 4];
    } next;
    memset(next.record.bytes, 0xff, sizeof next.record.bytes);
    memcpy(next.record.bytes, bytes, count);
    next.record.sequence = old ? old->sequence + 1 : 0;
    if (next.record.sequence == 0xffffffffu)
        next.record.sequence = 0;
    next.record.commit = ~next.record.sequence;

    FLASH->KEYR = FLASH_KEY1;
    FLASH->KEYR = FLASH_KEY2;
    bool good = finished() && erase(to_b ? BOARD_RECORD_B_SECTOR : BOARD_RECORD_A_SECTOR) &&
                program(address, next.words, sizeof next.words / 4);
    FLASH->CR = FLASH_CR_LOCK;
    return good && newest() == (to_b ? record_b() : record_a()) &&
           !memcmp(newest()->bytes, bytes, count);
}
