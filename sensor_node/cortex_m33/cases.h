/* What an operation is given, item by item, and what it gives back. */
#ifndef CASES_H
#define CASES_H

#include <stdint.h>

#include "rounding.h"

enum { INTEGER, REAL, INTEGERS, REALS, BYTES };

extern uint32_t elapsed;

/* Runs what is counted: nothing else stands between the two looks at the timer. */
#define COUNT(...)                         \
    do {                                   \
        uint32_t begin_ = TIMER;           \
        __asm volatile("" ::: "memory");   \
        __VA_ARGS__;                       \
        __asm volatile("" ::: "memory");   \
        elapsed = ELAPSED(begin_);         \
    } while (0)

int integer(void);
double real(void);
bounds_t bounds(void);
int32_t *integers(void);
double *reals(void);
uint8_t *bytes(void);
int length(const void *array);

/* A case by its name; nothing where there is none of it. */
void run_case(const char *name);

#endif
