#include "firmware/core/strobe.h"
#include "firmware/hal/hal_capture.h"

void strobe_init(struct strobe *strobe) {
    *strobe = (struct strobe){.pulse_us = 1000};
}

void strobe_arm(struct strobe *strobe, int32_t first, int32_t interval, uint16_t number) {
    strobe->next_pan = first;
    strobe->interval = interval;
    strobe->left = interval ? number : 1;
}

void strobe_disarm(struct strobe *strobe) {
    strobe->left = 0;
}

void strobe_trigger(struct strobe *strobe, int32_t pan, uint64_t now_us) {
    hal_capture_trigger(strobe->pulse_us);
    strobe->trigger_count++;
    strobe->trigger_pan = pan;
    strobe->trigger_us = now_us;
}

void strobe_pan(struct strobe *strobe, int32_t pan, bool positive, uint64_t now_us) {
    if (!strobe->left || pan != strobe->next_pan || positive != (strobe->interval >= 0))
        return;
    strobe->left--;
    /* Wraps only after 2^31 steps, which no axis can reach: registers bound first and interval *
     * number. */
    strobe->next_pan = (int32_t)((uint32_t)strobe->next_pan + (uint32_t)strobe->interval);
    strobe_trigger(strobe, pan, now_us);
}

void strobe_seen(struct strobe *strobe, int32_t pan, uint64_t t_us) {
    strobe->strobe_count++;
    strobe->strobe_pan = pan;
    strobe->strobe_us = t_us;
}
