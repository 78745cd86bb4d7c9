/* Bare metal on QEMU's mps2-an505: vectors, floating-point unit, SysTick and semihosting. */
#include "machine.h"

#include <string.h>

enum { OPEN = 1, CLOSE = 2, WRITE0 = 4, WRITE = 5, READ = 6, EXIT = 0x18 };
enum { READ_BINARY = 1, WRITE_BINARY = 5, FINISHED = 0x20026, FAILED = 0x20023 };

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010)
#define SYSTICK_RELOAD REGISTER(0xE000E014)
#define COPROCESSORS REGISTER(0xE000ED88)

extern uint32_t __stack__, __bss_start__, __bss_end__, __data_begin__, __data_end__, __data_load__;

static int call(int operation, const void *argument)
{
    register int r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static int open_file(const char *path, int mode)
{
    const uintptr_t given[] = {(uintptr_t)path, mode, strlen(path)};
    int file = call(OPEN, given);
    if (file < 0)
        leave("a file cannot be opened\n");
    return file;
}

int load(const char *path, void *buffer, int most)
{
    int file = open_file(path, READ_BINARY);
    const uintptr_t given[] = {file, (uintptr_t)buffer, most};
    int left = call(READ, given);
    call(CLOSE, &(uintptr_t){file});
    if (left <= 0)
        leave("the cases do not fit\n");
    return most - left;
}

void store(const char *path, const void *buffer, int length)
{
    int file = open_file(path, WRITE_BINARY);
    const uintptr_t given[] = {file, (uintptr_t)buffer, length};
    if (call(WRITE, given) != 0)
        leave("the results cannot be written\n");
    call(CLOSE, &(uintptr_t){file});
}

void leave(const char *why)
{
    if (why)
        call(WRITE0, why);
    call(EXIT, (const void *)(why ? FAILED : FINISHED));
    for (;;)
        ;
}

static void fail(void) { leave("the processor faulted\n"); }

static void reset(void)
{
    COPROCESSORS |= 0xF << 20;
    __asm volatile("dsb\nisb");
    memcpy(&__data_begin__, &__data_load__, (char *)&__data_end__ - (char *)&__data_begin__);
    memset(&__bss_start__, 0, (char *)&__bss_end__ - (char *)&__bss_start__);
    SYSTICK_RELOAD = 0xFFFFFF;
    TIMER = 0;
    SYSTICK_CONTROL = 5;
    main();
    leave(0);
}

__attribute__((section(".vectors"), used)) void *const VECTORS[16] = {
    &__stack__, reset, fail, fail, fail, fail, fail, fail};
