/* SPDX-License-Identifier: Apache-2.0
 *
 * The motors' two LMD18200 bridges, sign and magnitude: Timer1 in mode 14 (fast PWM, ICR1 on top) at 20 kHz; PWM left
 * on OC1A (PD5), right on OC1B (PD4); direction left on PD6, right on PD7 (high is forward); BRAKE of both on PC6.
 * Off is BRAKE high without PWM: both outputs float.
 */
#ifndef CRUNCH_AVR_PWM_H
#define CRUNCH_AVR_PWM_H

#include <stdint.h>

#define PWM_FULL 800

void pwm_init(void);

/* Each from -PWM_FULL to PWM_FULL. */
void pwm_drive(int16_t left, int16_t right);

void pwm_off(void);

#endif
