/* A block and a peak as messages: sensor_node/eskin_sensor_node/firmware/cbor.py, fields.py and record.py. */
#include "message.h"

enum { UNSIGNED = 0x00, NEGATIVE = 0x20, BYTES = 0x40, TEXT = 0x60, ARRAY = 0x80, MAP = 0xA0, TAG = 0xC0 };
enum { BLOCK = 1, PEAK = 2, Q16 = 2 };
static const uint8_t TAGS[] = {86, 85, 69}, WIDTHS[] = {8, 4, 2};

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

static uint8_t *text(uint8_t *out, int key, const char *value)
{
    size_t length = strlen(value);
    out = head_of(integer(out, key), TEXT, length);
    memcpy(out, value, length);
    return out + length;
}

static uint8_t *number(uint8_t *out, int key, int64_t value) { return integer(integer(out, key), value); }

static uint8_t *numbers(uint8_t *out, int key, int64_t one, int64_t other)
{
    return integer(integer(head_of(integer(out, key), ARRAY, 2), one), other);
}

static uint8_t *reals(uint8_t *out, int key, double one, double other)
{
    return real(real(head_of(integer(out, key), ARRAY, 2), one), other);
}

static uint8_t *content(uint8_t *out, int key, int encoding, const uint8_t *bytes, int length)
{
    out = head_of(head_of(integer(out, key), TAG, TAGS[encoding]), BYTES, length);
    memcpy(out, bytes, length);
    return out + length;
}

static uint8_t *begin(uint8_t *out, int kind, int fields, const head_t *head)
{
    out = number(head_of(out, MAP, fields), 1, kind);
    out = number(number(out, 2, head->boot), 3, head->sequence);
    return text(text(out, 4, head->name), 5, head->unit);
}

int write_block(uint8_t *buffer, const head_t *head, const written_t *written, const uint8_t *lo,
                const uint8_t *hi)
{
    int encoding = head->encoding, length = WIDTHS[encoding] * head->n;
    uint8_t *out = begin(buffer, BLOCK, encoding == Q16 ? 17 : 15, head);
    out = numbers(number(out, 6, head->ticks), 7, head->earliest, head->latest);
    out = number(number(out, 8, head->dt), 9, head->n);
    out = number(real(integer(out, 10), head->coverage), 11, encoding);
    out = content(content(out, 12, encoding, lo, length), 13, encoding, hi, length);
    out = reals(out, 14, written->lowest, written->highest);
    if (encoding == Q16)
        out = number(number(out, 15, written->exponent), 16, written->offset);
    double widening = written->widening > 0.0 ? up(written->widening) : 0.0;
    return real(integer(out, 17), widening) - buffer;
}

int write_peak(uint8_t *buffer, const head_t *head, const event_t *event)
{
    uint8_t *out = begin(buffer, PEAK, 11, head);
    out = number(numbers(out, 6, head->earliest, head->latest), 7, event->verdict);
    out = event->verdict == POSSIBLE ? numbers(out, 8, 0, event->peaks) : numbers(out, 8, 1, 1);
    out = reals(out, 9, event->height.lo, event->height.hi);
    out = reals(out, 10, event->prominence.lo, event->prominence.hi);
    return real(integer(out, 11), head->coverage) - buffer;
}
