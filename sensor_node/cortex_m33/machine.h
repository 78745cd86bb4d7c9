/* The machine under the operations that are counted: start, files of the host, and its timer. */
#ifndef MACHINE_H
#define MACHINE_H

#include <stdint.h>

enum { MOST_CASES = 6 << 20, MOST_RESULTS = 6 << 20 };

/* The timer goes down; QEMU's -icount lets it follow the instructions alone. */
#define TIMER (*(volatile uint32_t *)0xE000E018)
#define ELAPSED(begin) (((begin)-TIMER) & 0xFFFFFF)

int load(const char *path, void *buffer, int most);
void store(const char *path, const void *buffer, int length);
void leave(const char *why) __attribute__((noreturn));

int main(void);

#endif
