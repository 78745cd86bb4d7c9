/* Three-valued formulas over the past, decided at each sample. */
#ifndef MONITOR_H
#define MONITOR_H

#include <stdint.h>

typedef int64_t tick_t;

enum { NEVER_SEEN = -1, MOST_LINES = 24, MOST_ATOMS = 8, MOST_EDGES = 128, MOST_OPERANDS = 8 };

/* A set of ticks: the first and the last tick of each run, ascending. */
typedef struct {
    int n;
    tick_t edge[MOST_EDGES];
} runs_t;

typedef struct {
    runs_t side[2];
} pair_t;

typedef struct {
    int op, taken, number;
    tick_t from[2], to[2];
    runs_t result[2];
    int kept[2], was[2];
} line_t;

typedef struct {
    int32_t certain[2], possible[2];
    tick_t period, lasting, expected, until, before;
    int verdict, former, fresh;
} atom_t;

typedef struct {
    int lines, atoms;
    line_t line[MOST_LINES];
    atom_t atom[MOST_ATOMS];
    tick_t begin;
} monitor_t;

/* Takes instructions of five numbers, and atoms of five: codes, and ns from sample to sample. */
void begin_monitor(monitor_t *made, const int32_t *lines, int count, const int32_t *atoms, int many,
                   int drift);

/* Decides with the code of each atom now; one that is not sampled has none. */
int step(monitor_t *monitor, tick_t now, const int32_t *codes);

#endif
