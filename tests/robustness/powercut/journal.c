/* Keeps a journal of what a process does to the files of one folder, in its order.
 *
 * Preloaded by LD_PRELOAD. JOURNAL_OF names the folder, JOURNAL the file that takes the journal: for
 * each call a head (see struct head), the file's path, and the bytes that were written. Nothing is
 * really synchronised: that a disk was asked to is all that counts here.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

struct head {
  uint32_t deed; /* 'w' write, 't' truncate, 's' synchronise, 'u' unlink */
  uint32_t path;
  uint64_t offset; /* of a write; the size for a truncation */
  uint64_t length;
};

static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;
static const char *folder;
static int journal = -1;

__attribute__((constructor)) static void begin(void) {
  const char *path = getenv("JOURNAL");
  folder = getenv("JOURNAL_OF");
  journal = path && folder ? open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600) : -1;
}

static int ours(const char *path) {
  return journal >= 0 && !strncmp(path, folder, strlen(folder));
}

/* The path of an open file, if it lies in the folder. */
static const char *path_of(int file, char found[PATH_MAX]) {
  char link[64];
  snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  ssize_t length = journal >= 0 ? readlink(link, found, PATH_MAX - 1) : -1;
  if (length < 0) {
    return NULL;
  }
  found[length] = 0;
  return ours(found) ? found : NULL;
}

static void note(char deed, const char *path, uint64_t offset, const void *data, size_t length) {
  struct head head = {(uint32_t)deed, (uint32_t)strlen(path), offset, length};
  struct iovec parts[] = {{&head, sizeof head}, {(void *)path, head.path}, {(void *)data, length}};
  ssize_t whole = (ssize_t)(sizeof head + head.path + length);
  if (writev(journal, parts, 3) != whole) {
    abort();
  }
}

static ssize_t put(int file, const void *data, size_t length, off_t offset, int moves) {
  char found[PATH_MAX];
  const char *path = path_of(file, found);
  pthread_mutex_lock(&turn);
  off_t place = moves ? lseek(file, 0, SEEK_CUR) : offset;
  ssize_t done = moves ? syscall(SYS_write, file, data, length)
                       : syscall(SYS_pwrite64, file, data, length, offset);
  if (path && done > 0) {
    note('w', path, (uint64_t)place, data, (size_t)done);
  }
  pthread_mutex_unlock(&turn);
  return done;
}

ssize_t write(int file, const void *data, size_t length) { return put(file, data, length, 0, 1); }

ssize_t pwrite(int file, const void *data, size_t length, off_t offset) {
  return put(file, data, length, offset, 0);
}

ssize_t pwrite64(int file, const void *data, size_t length, off64_t offset) {
  return put(file, data, length, offset, 0);
}

int ftruncate(int file, off_t size) {
  char found[PATH_MAX];
  const char *path = path_of(file, found);
  pthread_mutex_lock(&turn);
  long failed = syscall(SYS_ftruncate, file, size);
  if (path && !failed) {
    note('t', path, (uint64_t)size, NULL, 0);
  }
  pthread_mutex_unlock(&turn);
  return (int)failed;
}

int ftruncate64(int file, off64_t size) { return ftruncate(file, size); }

int fsync(int file) {
  char found[PATH_MAX];
  const char *path = path_of(file, found);
  pthread_mutex_lock(&turn);
  if (path) {
    note('s', path, 0, NULL, 0);
  }
  pthread_mutex_unlock(&turn);
  return 0;
}

int fdatasync(int file) { return fsync(file); }

int unlink(const char *path) {
  pthread_mutex_lock(&turn);
  long failed = syscall(SYS_unlink, path);
  if (!failed && ours(path)) {
    note('u', path, 0, NULL, 0);
  }
  pthread_mutex_unlock(&turn);
  return (int)failed;
}
