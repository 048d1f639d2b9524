/* A layer before the C library that lets one folder's disk be slow, read-only or broken.

   The first byte of the file $DISK_MODE says how it is: s slow, r read-only, e broken, else well.
   The folder is $DISK_FOLDER. Built and preloaded by disk.py. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *mode, *folder;

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("DISK_MODE");
    int fd = path ? open(path, O_RDONLY) : -1;
    folder = getenv("DISK_FOLDER");
    if (fd >= 0) {
        void *at = mmap(0, 1, PROT_READ, MAP_SHARED, fd, 0);
        mode = at == MAP_FAILED ? 0 : at;
        close(fd);
    }
}

static int fails(const char *path) {
    if (!mode || !folder || !strchr("sre", *mode) || strncmp(path, folder, strlen(folder)))
        return 0;
    if (*mode == 's') {
        usleep(50000);
        return 0;
    }
    errno = *mode == 'r' ? EROFS : EIO;
    return 1;
}

static int fd_fails(int fd) {
    char link[32], path[4096];
    if (!mode || !*mode || *mode == '-')
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    path[n < 0 ? 0 : n] = 0;
    return fails(path);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define ON_FD(type, name, test, params, ...) \
    type name params { return test ? -1 : REAL(name)(__VA_ARGS__); }
#define OPEN(name)                                              \
    int name(const char *path, int flags, ...) {                \
        va_list more;                                           \
        va_start(more, flags);                                  \
        int bits = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, int) : 0; \
        va_end(more);                                           \
        return (flags & (O_ACCMODE | O_CREAT)) && fails(path) ? -1 : REAL(name)(path, flags, bits); \
    }

OPEN(open)
OPEN(open64)
ON_FD(ssize_t, write, fd_fails(fd), (int fd, const void *data, size_t n), fd, data, n)
ON_FD(ssize_t, pwrite, fd_fails(fd), (int fd, const void *data, size_t n, off_t at), fd, data, n, at)
ON_FD(ssize_t, pwrite64, fd_fails(fd), (int fd, const void *data, size_t n, off64_t at), fd, data, n, at)
ON_FD(int, ftruncate, fd_fails(fd), (int fd, off_t n), fd, n)
ON_FD(int, ftruncate64, fd_fails(fd), (int fd, off64_t n), fd, n)
ON_FD(int, fsync, fd_fails(fd), (int fd), fd)
ON_FD(int, fdatasync, fd_fails(fd), (int fd), fd)
ON_FD(int, mkdir, fails(path), (const char *path, mode_t bits), path, bits)
ON_FD(int, unlink, fails(path), (const char *path), path)
ON_FD(int, rename, fails(path), (const char *path, const char *to), path, to)
