/* SPDX-License-Identifier: Apache-2.0 */
#include "microcontroller.h"

#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_irq.h>

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

/* Data-space addresses. */
enum { UBRRL = 0x29, UCSRA = 0x2B, EECR = 0x3C, ICR1 = 0x46, OCR1B = 0x48, OCR1A = 0x4A, TCCR1A = 0x4F };
enum { MCUCSR = 0x54 };
enum { RAM_START = 0x60, RAM_END = 0x860 };

#define BITS_PER_BYTE 10
#define MS_CYCLES (MICROCONTROLLER_HZ / 1000)
#define WAITING 4096
#define PAINT 0xC5
#define UNREAD 2 /* bytes that the receiver holds */
#define SUPPLY_MV 5000
#define BROWN_OUT 0x04 /* MCUCSR: BORF */
#define EEPROM_CYCLES (MICROCONTROLLER_HZ / 10000 * 85)

enum { EERE = 1, EEWE = 2, EEMWE = 4 }; /* in EECR */

struct encoder {
    struct microcontroller *mcu;
    int index;
    int64_t ticks, target; /* shown and to be shown */
    uint64_t spacing;      /* cycles between edges */
};

struct order { /* a pin to be changed later */
    struct microcontroller *mcu;
    char port;
    int bit;
    bool level;
};

struct outside { /* inputs of a port that something drives, and how */
    uint8_t driven, levels;
};

struct microcontroller {
    avr_t *avr;
    struct outside outside[4]; /* ports A to D */
    avr_uart_t *uart;
    avr_irq_t *receiver;
    avr_irq_t *bus;
    bool is_bus_taken; /* a part has answered */
    struct wiring wiring;
    void (*core_reset)(avr_t *);
    struct encoder encoders[2];
    struct order orders[2][8][2]; /* ports B and D; bit; level */
    struct sent_byte sent[MICROCONTROLLER_SENT];
    int32_t sent_count;
    uint64_t line_free; /* when the last byte's stop bit is over */
    uint8_t waiting[WAITING];
    uint32_t waiting_head, waiting_tail;
    bool is_receiving;
    uint32_t resets, overruns;
    uint64_t slept;
    uint64_t woken, longest_awake;
    uint64_t eeprom_free; /* cycle at which the byte under way is written */
    uint32_t hasty;
};

static void say_nothing(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr, (void)level, (void)format, (void)arguments;
}

static struct microcontroller *of(avr_t *avr)
{
    return (struct microcontroller *)avr->custom.data;
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    struct microcontroller *mcu = of(avr);
    const uint64_t awake = avr->cycle > mcu->woken ? avr->cycle - mcu->woken : 0;
    mcu->longest_awake = awake > mcu->longest_awake ? awake : mcu->longest_awake;
    mcu->slept += cycles;
    mcu->woken = avr->cycle + cycles;
}

/* simavr polls INT0 and INT1 anew after each reset. */
static void on_reset(avr_t *avr)
{
    struct microcontroller *mcu = of(avr);
    mcu->resets++;
    if (mcu->core_reset)
        mcu->core_reset(avr);
}

static void stop_polling(struct microcontroller *mcu)
{
    for (uint8_t i = 0; i < 2; i++)
        avr_extint_set_strict_lvl_trig(mcu->avr, i, 0);
}

static uint64_t byte_cycles(const struct microcontroller *mcu)
{
    const uint8_t *data = mcu->avr->data;
    const uint64_t clocks_per_bit = data[UCSRA] & 2 ? 8 : 16; /* U2X */
    return BITS_PER_BYTE * clocks_per_bit * (data[UBRRL] + 1u);
}

static void on_sent(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct microcontroller *mcu = param;
    const uint64_t now = mcu->avr->cycle;
    const struct sent_byte sent = {
        .start = now > mcu->line_free ? now : mcu->line_free,
        .end = (now > mcu->line_free ? now : mcu->line_free) + byte_cycles(mcu),
        .byte = (uint8_t)value,
    };
    mcu->line_free = sent.end;
    if (mcu->sent_count < MICROCONTROLLER_SENT)
        mcu->sent[mcu->sent_count++] = sent;
}

static void on_convert(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct microcontroller *mcu = param;
    const union {
        uint32_t value;
        avr_adc_mux_t mux;
    } trigger = {.value = value};
    if (trigger.mux.kind == ADC_MUX_SINGLE && mcu->wiring.on_convert)
        mcu->wiring.on_convert(mcu->wiring.owner, (int)trigger.mux.src);
}

static void on_pin(struct microcontroller *mcu, char port, avr_irq_t *irq, uint32_t value)
{
    const int bit = (int)(irq->irq & 7u);
    if (mcu->wiring.on_pin && mcu->avr->data[port == 'B' ? 0x37 : 0x34] >> bit & 1) /* DDRB, DDRC */
        mcu->wiring.on_pin(mcu->wiring.owner, port, bit, value & 1);
}

static void on_port_b(avr_irq_t *irq, uint32_t value, void *param)
{
    on_pin(param, 'B', irq, value);
}

static void on_port_c(avr_irq_t *irq, uint32_t value, void *param)
{
    on_pin(param, 'C', irq, value);
}

static uint8_t read_eecr(avr_t *avr, avr_io_addr_t address, void *param)
{
    const struct microcontroller *mcu = param;
    const uint8_t shown = (uint8_t)(avr->data[address] & ~EEWE);
    return avr->cycle < mcu->eeprom_free ? shown | EEWE : shown;
}

/* After simavr's own, which does what it is told at once. */
static void write_eecr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)address;
    struct microcontroller *mcu = param;
    const bool is_busy = avr->cycle < mcu->eeprom_free;
    mcu->hasty += is_busy && (value & (EERE | EEMWE));
    if (!is_busy && (value & EEWE) && (value & EEMWE))
        mcu->eeprom_free = avr->cycle + EEPROM_CYCLES;
}

static avr_irq_t *pin_of(const struct microcontroller *mcu, char port, int bit)
{
    return avr_io_getirq(mcu->avr, (uint32_t)AVR_IOCTL_IOPORT_GETIRQ(port), bit);
}

static void answer_bus(struct microcontroller *mcu, uint8_t kind, uint8_t data)
{
    avr_raise_irq(mcu->bus, avr_twi_irq_msg(kind, 0, data));
}

static void on_bus(avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct microcontroller *mcu = param;
    const struct wiring *wiring = &mcu->wiring;
    const avr_twi_msg_irq_t message = {.u = {.v = value}};
    const uint8_t kind = message.u.twi.msg;
    if (kind & TWI_COND_START)
        mcu->is_bus_taken = wiring->on_bus_start && wiring->on_bus_start(wiring->owner, message.u.twi.addr >> 1);
    if (kind & TWI_COND_STOP)
        mcu->is_bus_taken = false;
    if (!mcu->is_bus_taken)
        return;
    if (kind & TWI_COND_WRITE)
        wiring->on_bus_byte(wiring->owner, message.u.twi.data);
    if (kind & (TWI_COND_START | TWI_COND_WRITE))
        answer_bus(mcu, TWI_COND_ACK, 1);
    if (kind & TWI_COND_READ)
        answer_bus(mcu, TWI_COND_READ, wiring->on_bus_ask(wiring->owner));
}

static void listen(struct microcontroller *mcu)
{
    avr_t *avr = mcu->avr;
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT), on_bus, mcu);
    mcu->bus = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_sent, mcu);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_convert, mcu);
    for (int bit = 0; bit < 8; bit++) {
        avr_irq_register_notify(pin_of(mcu, 'B', bit), on_port_b, mcu);
        avr_irq_register_notify(pin_of(mcu, 'C', bit), on_port_c, mcu);
    }
    avr_register_io_read(avr, EECR, read_eecr, mcu);
    avr_register_io_write(avr, EECR, write_eecr, mcu);
    mcu->receiver = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart"))
            mcu->uart = (avr_uart_t *)io;
}

static void tune(struct microcontroller *mcu)
{
    avr_t *avr = mcu->avr;
    uint32_t no_flags = 0;
    avr->frequency = MICROCONTROLLER_HZ;
    avr->vcc = avr->avcc = avr->aref = SUPPLY_MV;
    avr->sleep = no_sleep;
    mcu->core_reset = avr->reset;
    avr->reset = on_reset;
    mcu->resets = 1;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &no_flags);
    memset(avr->data + RAM_START, PAINT, RAM_END - RAM_START);
}

struct microcontroller *microcontroller_new(const char *elf, const struct wiring *wiring)
{
    elf_firmware_t firmware = {0};
    avr_global_logger_set(say_nothing);
    if (elf_read_firmware(elf, &firmware))
        return NULL;
    struct microcontroller *mcu = calloc(1, sizeof *mcu);
    avr_t *avr = avr_make_mcu_by_name("atmega32");
    if (!mcu || !avr)
        abort();
    mcu->avr = avr;
    mcu->wiring = *wiring;
    avr->custom.data = mcu;
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    tune(mcu);
    listen(mcu);
    return mcu;
}

void microcontroller_free(struct microcontroller *mcu)
{
    avr_terminate(mcu->avr);
    free(mcu->avr);
    free(mcu);
}

static avr_cycle_count_t stop_here(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr, (void)when, (void)param;
    return 0; /* being a timer, it has ended a sleep */
}

bool microcontroller_run(struct microcontroller *mcu, uint64_t until)
{
    avr_t *avr = mcu->avr;
    stop_polling(mcu);
    mcu->uart->cycles_per_byte = byte_cycles(mcu);
    if (until > avr->cycle)
        avr_cycle_timer_register(avr, until - avr->cycle, stop_here, mcu);
    while (avr->cycle < until) {
        const int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return false;
    }
    return true;
}

uint64_t microcontroller_cycle(const struct microcontroller *mcu)
{
    return mcu->avr->cycle;
}

void microcontroller_voltage(struct microcontroller *mcu, int channel, double volts)
{
    const double mv = fmax(0.0, fmin(SUPPLY_MV, volts * 1000.0 + 0.5));
    avr_raise_irq(avr_io_getirq(mcu->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel), (uint32_t)mv);
}

/* A write to the port would take its pulled-up inputs high, whatever is outside. */
static void keep_level(struct microcontroller *mcu, char port, int bit, bool level)
{
    struct outside *outside = &mcu->outside[port - 'A'];
    outside->driven |= (uint8_t)(1u << bit);
    outside->levels = (uint8_t)((outside->levels & ~(1u << bit)) | (unsigned)level << bit);
    avr_ioport_external_t external = {
        .name = (unsigned)port & 0x7Fu, .mask = outside->driven, .value = outside->levels,
    };
    avr_ioctl(mcu->avr, (uint32_t)AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
}

void microcontroller_pin(struct microcontroller *mcu, char port, int bit, bool level)
{
    keep_level(mcu, port, bit, level);
    avr_raise_irq(pin_of(mcu, port, bit), level);
}

static avr_cycle_count_t obey_order(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr, (void)when;
    const struct order *order = param;
    microcontroller_pin(order->mcu, order->port, order->bit, order->level);
    return 0;
}

void microcontroller_pin_later(struct microcontroller *mcu, char port, int bit, bool level, uint64_t cycles)
{
    struct order *order = &mcu->orders[port == 'D'][bit][level];
    const struct order wanted = {.mcu = mcu, .port = port, .bit = bit, .level = level};
    *order = wanted;
    avr_cycle_timer_register(mcu->avr, cycles, obey_order, order);
}

bool microcontroller_output(const struct microcontroller *mcu, char port, int bit)
{
    avr_ioport_state_t state;
    avr_ioctl(mcu->avr, (uint32_t)AVR_IOCTL_IOPORT_GETSTATE(port), &state);
    return (state.port & state.ddr) >> bit & 1;
}

static unsigned word_at(const struct microcontroller *mcu, int address)
{
    return mcu->avr->data[address] | (unsigned)mcu->avr->data[address + 1] << 8;
}

double microcontroller_pwm(const struct microcontroller *mcu, int output)
{
    const int mode = mcu->avr->data[TCCR1A] >> (output ? 4 : 6) & 3;
    const unsigned top = word_at(mcu, ICR1);
    if (mode != 2 || top == 0)
        return 0.0;
    return (word_at(mcu, output ? OCR1B : OCR1A) + 1.0) / (top + 1.0);
}

/* One edge of A. Forward, A leads B: they differ after it. */
static avr_cycle_count_t turn_on(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    struct encoder *encoder = param;
    if (encoder->ticks == encoder->target)
        return 0;
    const bool is_forward = encoder->target > encoder->ticks;
    encoder->ticks += is_forward ? 1 : -1;
    const bool a = encoder->ticks & 1;
    microcontroller_pin(encoder->mcu, 'B', encoder->index, is_forward ? !a : a);
    microcontroller_pin(encoder->mcu, 'D', 2 + encoder->index, a);
    return encoder->ticks == encoder->target ? 0 : when + encoder->spacing;
}

void microcontroller_turn(struct microcontroller *mcu, int index, int64_t ticks)
{
    struct encoder *encoder = &mcu->encoders[index];
    encoder->mcu = mcu;
    encoder->index = index;
    encoder->target = ticks;
    const uint64_t edges = (uint64_t)llabs(ticks - encoder->ticks);
    if (edges == 0)
        return;
    encoder->spacing = MS_CYCLES / (edges + 1);
    avr_cycle_timer_register(mcu->avr, encoder->spacing, turn_on, encoder);
}

static unsigned unread(const struct microcontroller *mcu)
{
    const uart_fifo_t *fifo = &mcu->uart->input;
    return (unsigned)(fifo->write - fifo->read) % uart_fifo_fifo_size;
}

/* One byte for the receiver, then the next one a byte's time later. */
static avr_cycle_count_t deliver(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    struct microcontroller *mcu = param;
    mcu->is_receiving = mcu->waiting_head != mcu->waiting_tail;
    if (!mcu->is_receiving)
        return 0;
    const uint8_t byte = mcu->waiting[mcu->waiting_tail];
    mcu->waiting_tail = (mcu->waiting_tail + 1) % WAITING;
    if (unread(mcu) < UNREAD)
        avr_raise_irq(mcu->receiver, byte);
    else
        mcu->overruns++;
    return when + byte_cycles(mcu);
}

void microcontroller_receive(struct microcontroller *mcu, const uint8_t *bytes, int32_t count)
{
    for (int32_t i = 0; i < count && (mcu->waiting_head + 1) % WAITING != mcu->waiting_tail; i++) {
        mcu->waiting[mcu->waiting_head] = bytes[i];
        mcu->waiting_head = (mcu->waiting_head + 1) % WAITING;
    }
    if (mcu->is_receiving || mcu->waiting_head == mcu->waiting_tail)
        return;
    mcu->is_receiving = true;
    avr_cycle_timer_register(mcu->avr, 1, deliver, mcu);
}

int32_t microcontroller_take_sent(struct microcontroller *mcu, struct sent_byte *sent)
{
    const int32_t count = mcu->sent_count;
    memcpy(sent, mcu->sent, (size_t)count * sizeof *sent);
    mcu->sent_count = 0;
    return count;
}

uint32_t microcontroller_resets(const struct microcontroller *mcu)
{
    return mcu->resets;
}

uint32_t microcontroller_overruns(const struct microcontroller *mcu)
{
    return mcu->overruns;
}

uint64_t microcontroller_slept(const struct microcontroller *mcu)
{
    return mcu->slept;
}

uint64_t microcontroller_longest_awake(struct microcontroller *mcu)
{
    const uint64_t longest = mcu->longest_awake;
    mcu->longest_awake = 0;
    return longest;
}

int32_t microcontroller_untouched(const struct microcontroller *mcu)
{
    int32_t longest = 0, run = 0;
    for (int address = RAM_START; address < RAM_END; address++) {
        run = mcu->avr->data[address] == PAINT ? run + 1 : 0;
        longest = run > longest ? run : longest;
    }
    return longest;
}

uint8_t microcontroller_peek(const struct microcontroller *mcu, uint16_t address)
{
    return mcu->avr->data[address];
}

void microcontroller_poke(struct microcontroller *mcu, uint16_t address, uint8_t value)
{
    mcu->avr->data[address] = value;
}

void microcontroller_brown_out(struct microcontroller *mcu)
{
    avr_reset(mcu->avr);
    mcu->avr->data[MCUCSR] |= BROWN_OUT;
}

void microcontroller_reset(struct microcontroller *mcu)
{
    avr_reset(mcu->avr);
}

uint8_t microcontroller_eeprom(struct microcontroller *mcu, uint16_t address)
{
    uint8_t byte = 0;
    avr_eeprom_desc_t desc = {.ee = &byte, .offset = address, .size = 1};
    avr_ioctl(mcu->avr, AVR_IOCTL_EEPROM_GET, &desc);
    return byte;
}

void microcontroller_spoil(struct microcontroller *mcu, uint16_t address, uint8_t value)
{
    avr_eeprom_desc_t desc = {.ee = &value, .offset = address, .size = 1};
    avr_ioctl(mcu->avr, AVR_IOCTL_EEPROM_SET, &desc);
}

uint32_t microcontroller_hasty(const struct microcontroller *mcu)
{
    return mcu->hasty;
}

/* With interrupts off and asleep simavr would be done; a jump to itself (rjmp .-2) in erased flash spins. */
void microcontroller_hang(struct microcontroller *mcu, bool is_deaf)
{
    avr_t *avr = mcu->avr;
    const avr_flashaddr_t at = avr->flashend - 1;
    avr->flash[at] = 0xFF;
    avr->flash[at + 1] = 0xCF;
    avr->sreg[S_I] = !is_deaf;
    avr->state = cpu_Running;
    avr->pc = at;
}
