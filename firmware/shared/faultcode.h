/* Fault, refusal, state and reset codes of the cart controller, as they appear in its registers.
 * Shared by the firmware and the host: numbers never change meaning, new ones go at the end. */
#ifndef SC_SHARED_FAULTCODE_H
#define SC_SHARED_FAULTCODE_H

#ifdef __cplusplus
extern "C" {
#endif

/* X(NAME, number, text for a person, meaning of the context register) */
#define FAULTCODE_LIST(X)                                                                          \
    X(NONE, 0, "no fault", "0")                                                                    \
    X(ESTOP, 1, "emergency stop pressed", "safety input bits")                                     \
    X(INTERLOCK, 2, "laser interlock open", "safety input bits")                                   \
    X(DOOR, 3, "cover open", "safety input bits")                                                  \
    X(OVER_TEMP, 4, "over-temperature", "temperature, 0.1 C")                                      \
    X(TEMP_SENSOR, 5, "temperature sensor gives no value", "0")                                    \
    X(PAN_LIMIT, 6, "pan ran into a limit switch", "pan position, steps")                          \
    X(TILT_LIMIT, 7, "tilt ran into a limit switch", "tilt position, steps")                       \
    X(MIRROR_SLOW, 8, "mirror below its safe speed with the laser on", "speed, 0.001 rev/s")       \
    X(MIRROR_FAST, 9, "mirror above its maximum speed", "speed, 0.001 rev/s")                      \
    X(MIRROR_STALL, 10, "mirror does not reach the speed asked for", "speed, 0.001 rev/s")         \
    X(HOST_SILENT, 11, "no request from the host", "silence, ms")                                  \
    X(STACK, 12, "stack guard damaged or stack nearly full", "free bytes")                         \
    X(CLOCK, 13, "clock failed or the safety tick came late", "tick interval, us")                 \
    X(LOOP, 14, "main loop stalled", "stall, ms")                                                  \
    X(PAN_HOMING, 15, "pan homing found no home switch", "homing phase")                           \
    X(TILT_HOMING, 16, "tilt homing found no home switch", "homing phase")                         \
    X(LASER_STUCK, 17, "laser current flows although the laser is off", "0")                       \
    X(WATCHDOG, 18, "restarted by the hardware watchdog", "0")

enum faultcode {
#define X(name, number, text, context) FAULT_##name = (number),
    FAULTCODE_LIST(X)
#undef X
        FAULT_COUNT_
};

/* Why the last command was refused (register `refusal`); 0 after an accepted command. */
#define REFUSAL_LIST(X)                                                                            \
    X(NONE, 0, "accepted")                                                                         \
    X(FAULTED, 1, "a fault is latched: read it, remove the cause, clear it")                       \
    X(MOTORS_OFF, 2, "motors are not enabled")                                                     \
    X(NOT_HOMED, 3, "axis not homed")                                                              \
    X(MIRROR, 4, "mirror not in its speed range")                                                  \
    X(HOST, 5, "host watchdog not fed")                                                            \
    X(BUSY, 6, "axis busy: homing or scanning")                                                    \
    X(ENERGISED, 7, "only with motors and laser off")                                              \
    X(LIMIT, 8, "a limit switch is closed")                                                        \
    X(CONDITION, 9, "a fault condition is still present")                                          \
    X(RANGE, 10, "outside the soft limits or the commissioned range")                              \
    X(FLASH, 11, "flash write failed")                                                             \
    X(UNCOMMISSIONED, 12, "commissioning values missing or damaged")                               \
    X(WRONG_FAULT, 13, "fault_clear must be given the code of the latched fault")

enum refusal {
#define X(name, number, text) REFUSAL_##name = (number),
    REFUSAL_LIST(X)
#undef X
        REFUSAL_COUNT_
};

/* State of the safety machine (register `state`). */
enum ctlstate {
    CTLSTATE_IDLE = 0,  /* motors off, laser off */
    CTLSTATE_READY = 1, /* motors on, laser off */
    CTLSTATE_LASER = 2, /* motors on, laser on */
    CTLSTATE_FAULT = 3  /* everything off, latched until the fault is cleared */
};

enum resetcause {
    RESETCAUSE_POWER = 0,
    RESETCAUSE_PIN = 1,
    RESETCAUSE_WATCHDOG = 2,
    RESETCAUSE_SOFTWARE = 3,
    RESETCAUSE_BROWNOUT = 4,
    RESETCAUSE_UNKNOWN = 5
};

enum scanstate {
    SCANSTATE_OFF = 0,
    SCANSTATE_TO_START = 1, /* moving to `scan_from` with the backlash taken up */
    SCANSTATE_SWEEP = 2,    /* sweeping */
    SCANSTATE_DONE = 3      /* arrived at `scan_to` */
};

/* English text of a code, never NULL ("unknown"). Host side only: the firmware keeps no strings of
 * these. */
const char *faultcode_text(int code);
const char *faultcode_name(int code); /* "ESTOP" */
const char *faultcode_context(int code);
const char *refusal_text(int code);

#ifdef __cplusplus
}
#endif
#endif
