/* Runs the cases of a file one after the other, and writes what each took and gave.
 *
 * A file of cases: for each its name in 16 bytes, the number of its items, and they: a kind, a
 * length, and as many values. Results: for each case the timer's ticks, and all arrays as they are
 * afterwards. */
#include "machine.h"
#include "cases.h"

enum { MOST_ARRAYS = 32, NAME = 16 };

typedef struct {
    uint32_t kind, length;
} item_t;

static uint8_t cases[MOST_CASES] __attribute__((aligned(8), section(".noinit")));
static uint8_t results[MOST_RESULTS] __attribute__((section(".noinit")));
static uint8_t *next, *out = results;
static struct {
    void *values;
    uint32_t length, size;
} arrays[MOST_ARRAYS];
static int taken;
static const uint8_t SIZES[] = {4, 8, 4, 8, 1};

uint32_t elapsed;

static void *item(uint32_t kind)
{
    item_t found;
    memcpy(&found, next, sizeof found);
    if (found.kind != kind)
        leave("an item is of another kind\n");
    void *values = next + sizeof found;
    next += sizeof found + (found.length * SIZES[kind] + 7) / 8 * 8;
    if (kind >= INTEGERS) {
        if (taken == MOST_ARRAYS)
            leave("a case has too many arrays\n");
        arrays[taken].values = values, arrays[taken].size = SIZES[kind];
        arrays[taken++].length = found.length;
    }
    return values;
}

int integer(void) { return *(int32_t *)item(INTEGER); }

double real(void) { return *(double *)item(REAL); }

bounds_t bounds(void)
{
    double lo = real();
    return (bounds_t){lo, real()};
}

int32_t *integers(void) { return item(INTEGERS); }

double *reals(void) { return item(REALS); }

uint8_t *bytes(void) { return item(BYTES); }

int length(const void *array)
{
    for (int k = 0; k < taken; k++)
        if (arrays[k].values == array)
            return (int)arrays[k].length;
    leave("an array is none of the case's\n");
}

static void put(const void *values, uint32_t length)
{
    if (out + length > results + MOST_RESULTS)
        leave("the results do not fit\n");
    memcpy(out, values, length);
    out += length;
}

int main(void)
{
    uint8_t *end = cases + load("cases.bin", cases, MOST_CASES);
    for (next = cases; next < end;) {
        const char *name = (const char *)next;
        next += NAME;
        taken = 0;
        run_case(name);
        put(&elapsed, sizeof elapsed);
        for (int k = 0; k < taken; k++)
            put(arrays[k].values, arrays[k].length * arrays[k].size);
    }
    store("results.bin", results, (int)(out - results));
    return 0;
}
