/* Prints docs/registers.md, the manual page of the register map, from firmware/shared/regmap.def
 * and faultcode.h. Usage: regdoc > docs/registers.md (a test compares). */
#include "firmware/shared/faultcode.h"
#include "firmware/shared/idxevent.h"
#include "firmware/shared/regmap.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static const char *access_name(uint8_t access) {
    switch (access) {
    case REGMAP_CFG:
        return "setting";
    case REGMAP_CMD:
        return "command";
    case REGMAP_COM:
        return "commissioning";
    default:
        return "read";
    }
}

/* Unit with its scale, as "0.001 rev/s"; a dash for bare numbers. */
static void print_unit(const struct regmap_text *text) {
    if (!*text->unit && text->scale == 1.0)
        (void)fputs("-", stdout);
    else if (text->scale == 1.0)
        (void)fputs(text->unit, stdout);
    else if (text->scale < 1e-4)
        (void)printf("1/65536 %s", text->unit);
    else
        (void)printf("%g %s", text->scale, text->unit);
}

static void print_inputs(void) {
    (void)puts("## Input registers\n\nRead with function 4 or 3.\n\n"
               "| address | name | type | unit | meaning |\n|---|---|---|---|---|");
    for (int i = 0; i < REGMAP_INPUT_COUNT_; i++) {
        const struct regmap_text *text = &regmap_input_text[i];
        (void)printf("| 0x%04x | %s | %s | ", regmap_inputs[i].address, text->name, text->type);
        print_unit(text);
        (void)printf(" | %s |\n", text->doc);
    }
}

static void print_holdings(void) {
    (void)puts("\n## Holding registers\n\nRead with function 3, written with 6, 16, 22, 23.\n\n"
               "| address | name | type | unit | access | range | at reset | meaning |\n"
               "|---|---|---|---|---|---|--:|---|");
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++) {
        const struct regmap_entry *entry = &regmap_holdings[i];
        const struct regmap_text *text = &regmap_holding_text[i];
        (void)printf("| 0x%04x | %s | %s | ", entry->address, text->name, text->type);
        print_unit(text);
        (void)printf(" | %s | %" PRId64 " to %" PRId64 " | %" PRId64 " | %s |\n",
                     access_name(entry->access), entry->min, entry->max,
                     regmap_value(entry, &regmap_holding_initial), text->doc);
    }
}

static void print_bits(const char *title, const struct regmap_bit_text *bits, int count) {
    (void)printf("\n## %s\n\n| address | name | meaning |\n|---|---|---|\n", title);
    for (int i = 0; i < count; i++)
        (void)printf("| 0x%04x | %s | %s |\n", bits[i].address, bits[i].name, bits[i].doc);
}

static void print_events(void) {
    (void)printf(
        "\n## Event window\n\n"
        "Behind `event_record_size` follow %d records of %d words, the first at 0x%04x. One read "
        "of %d words "
        "from 0x%04x\ngives header and records of one instant. `event_from` chooses the first "
        "record; reading "
        "removes nothing, so a lost\nreply is simply asked for again, and function 23 sets "
        "`event_from` and "
        "reads the window in one request. The\ncontroller keeps the last 64 events. A host that "
        "asks for the "
        "number after the last one it has, and finds\n`event_first` greater than that, knows "
        "exactly how many "
        "it lost.\n\n"
        "| word | content |\n|---|---|\n"
        "| 0, 1 | sequence number, from 0, no gaps |\n"
        "| 2 to 5 | time of the edge, us, captured by hardware |\n"
        "| 6, 7 | revolution: index pulses since reset, this one and missed ones counted |\n"
        "| 8, 9 | pan position, steps |\n"
        "| 10, 11 | tilt position, steps |\n"
        "| 12 | part of the pan's way to its next step, 1/65536 |\n"
        "| 13 | flags |\n\n"
        "Flags: bits 0 to 3 kind (1 mirror index, 2 camera strobe); 4 pan moving; 5 tilt moving; 6 "
        "pan homed; "
        "7 tilt homed;\n8 pan's direction positive; 9 backlash taken up in that direction; 10 "
        "laser on; 11 part "
        "of a scan's sweep;\n12 mirror in range; 13 index pulses were missed before this one; 14 "
        "the pan step "
        "of the last revolution had not finished.\n",
        IDXEVENT_WINDOW, IDXEVENT_WORDS, IDXEVENT_FIRST_ADDR, IDXEVENT_WINDOW_WORDS,
        IDXEVENT_WINDOW_ADDR);
}

static void print_codes(void) {
    (void)puts("\n## Faults\n\n| code | name | meaning | fault_context |\n|--:|---|---|---|");
    for (int i = 1; i < FAULT_COUNT_; i++)
        (void)printf("| %d | %s | %s | %s |\n", i, faultcode_name(i), faultcode_text(i),
                     faultcode_context(i));
    (void)puts("\n## Refusals\n\n| code | meaning |\n|--:|---|");
    for (int i = 0; i < REFUSAL_COUNT_; i++)
        (void)printf("| %d | %s |\n", i, refusal_text(i));
}

int main(void) {
    (void)printf(
        "<!-- Written by scripts/regdoc.c from firmware/shared/regmap.def; a test compares. -->\n"
        "# Registers of the cart controller\n\n"
        "Map version %d. Modbus RTU, 8 data bits, no parity, 2 stop bits or 1, 115 200 baud unless "
        "the board says "
        "otherwise.\nAddresses are those on the wire (from 0). Values of more than one word have "
        "the most significant "
        "word at the lower\naddress, and are read consistently within one request; they are "
        "written whole or not at "
        "all. A raw value times its\nunit's factor is the value. Reading an address that is not "
        "listed gets exception "
        "02.\n\n"
        "Exceptions: 01 function, 02 address, 03 value out of range, 04 not now (a fault is "
        "latched, or `refusal` says "
        "why),\n06 busy or energised. A *setting* is accepted at any time; a *command* gets 04 "
        "while a fault is "
        "latched (switching off is\nalways accepted); a *commissioning* value can be written only "
        "with motors and "
        "laser off, and is lost at reset\nunless saved.\n\n",
        REGMAP_VERSION);
    print_inputs();
    print_events();
    print_holdings();
    print_bits("Coils", regmap_coil_text, REGMAP_COIL_COUNT_);
    print_bits("Discrete inputs", regmap_discrete_text, REGMAP_DISCRETE_COUNT_);
    print_codes();
    return fflush(stdout) != 0;
}
