/* Adds milliseconds to each fdatasync of a process, as PostgreSQL flushes its log by default:
 * LD_PRELOAD it, with SLOW_FLUSH_MS set. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <unistd.h>

int fdatasync(int file)
{
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, "fdatasync");
    const char *text = getenv("SLOW_FLUSH_MS");

    usleep(1000 * (text == NULL ? 0 : atoi(text)));
    return real(file);
}
