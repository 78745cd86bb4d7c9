/* A peak as a statement: firmware/cbor.py and message_writer.py of the sensor node. */
#include "message.h"

enum { UNSIGNED = 0x00, NEGATIVE = 0x20, BYTES = 0x40, ARRAY = 0x80, MAP = 0xA0 };
enum { STATEMENTS = 2, LAYOUT_BYTES = 32, OF_PEAK = 8, CASE_PATCH = 3, CASE_COLUMN = 1 };

static uint8_t *head_of(uint8_t *out, int major, uint64_t value)
{
    int size = value < 24 ? 0 : value < 0x100 ? 1 : value < 0x10000 ? 2 : value < 0x100000000 ? 4 : 8;
    if (size == 0) {
        *out++ = (uint8_t)(major | value);
        return out;
    }
    *out++ = (uint8_t)(major | (size == 1 ? 24 : size == 2 ? 25 : size == 4 ? 26 : 27));
    for (int k = size - 1; k >= 0; k--)
        *out++ = (uint8_t)(value >> (8 * k));
    return out;
}

static uint8_t *integer(uint8_t *out, int64_t value)
{
    return value >= 0 ? head_of(out, UNSIGNED, value) : head_of(out, NEGATIVE, -1 - value);
}

static uint8_t *real(uint8_t *out, double value)
{
    if (value - value != 0.0) {
        *out++ = 0xF9, *out++ = value > 0.0 ? 0x7C : 0xFC, *out++ = 0;
        return out;
    }
    uint64_t bits;
    memcpy(&bits, &value, 8);
    *out++ = 0xFB;
    for (int k = 7; k >= 0; k--)
        *out++ = (uint8_t)(bits >> (8 * k));
    return out;
}

static uint8_t *number(uint8_t *out, int key, int64_t value) { return integer(integer(out, key), value); }

static uint8_t *integers(uint8_t *out, int64_t one, int64_t other)
{
    return integer(integer(head_of(out, ARRAY, 2), one), other);
}

static uint8_t *reals(uint8_t *out, double one, double other)
{
    return real(real(head_of(out, ARRAY, 2), one), other);
}

int write_peak(uint8_t *buffer, const head_t *head, const event_t *event)
{
    uint8_t *out = number(head_of(buffer, MAP, 5), 1, STATEMENTS);
    out = number(number(out, 2, head->boot), 3, head->sequence);
    out = head_of(integer(out, 4), BYTES, LAYOUT_BYTES);
    memcpy(out, head->layout, LAYOUT_BYTES);
    out = head_of(head_of(integer(out + LAYOUT_BYTES, 5), ARRAY, 1), ARRAY, OF_PEAK);
    out = integer(integer(out, CASE_PATCH), CASE_COLUMN);
    out = integer(integers(out, head->earliest, head->latest), event->verdict);
    out = event->verdict == POSSIBLE ? integers(out, 0, event->peaks) : integers(out, 1, 1);
    out = reals(out, event->height.lo, event->height.hi);
    out = reals(out, event->prominence.lo, event->prominence.hi);
    return real(out, head->coverage) - buffer;
}
