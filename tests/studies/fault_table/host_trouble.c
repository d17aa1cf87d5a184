/* Trouble of a computer, for the one program that this library is preloaded into.
 *
 * While the file $HOST_TROUBLE/clock-back or clock-forward exists, the wall clock is wrong by an
 * hour; while $HOST_TROUBLE/read-only exists, nothing below $HOST_TROUBLE_DISK can be written, as
 * when the kernel has remounted a failing disk; while $HOST_TROUBLE/disk-full exists, nothing there
 * can be made or grow; while $HOST_TROUBLE/slow-disk exists, each synchronisation of a file there
 * takes 300 ms. Monotonic clocks are left alone, as a jump does.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define JUMP_S 3600
#define SLOW_NS 300000000

static int is_on(const char *trouble) {
    char path[PATH_MAX];
    int before = errno;
    const char *folder = getenv("HOST_TROUBLE");
    snprintf(path, sizeof path, "%s/%s", folder ? folder : "", trouble);
    int found = syscall(SYS_faccessat, AT_FDCWD, path, F_OK) == 0;
    errno = before;
    return found;
}

static time_t jump_s(void) { return JUMP_S * (is_on("clock-forward") - is_on("clock-back")); }

int clock_gettime(clockid_t clock, struct timespec *now) {
    int status = syscall(SYS_clock_gettime, clock, now);
    if (status == 0 && clock == CLOCK_REALTIME) now->tv_sec += jump_s();
    return status;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    int status = syscall(SYS_gettimeofday, now, zone);
    if (status == 0) now->tv_sec += jump_s();
    return status;
}

time_t time(time_t *out) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (out) *out = now.tv_sec;
    return now.tv_sec;
}

static int is_refused(const char *path) {
    const char *disk = getenv("HOST_TROUBLE_DISK");
    if (!disk || strncmp(path, disk, strlen(disk)) || !is_on("read-only")) return 0;
    errno = EROFS;
    return 1;
}

/* What needs room: on a full disk a name can still be changed or taken away. */
static int has_no_room(const char *path) {
    const char *disk = getenv("HOST_TROUBLE_DISK");
    if (is_refused(path)) return 1;
    if (!disk || strncmp(path, disk, strlen(disk)) || !is_on("disk-full")) return 0;
    errno = ENOSPC;
    return 1;
}

/* The path of an open file; empty where it has none. */
static const char *path_of(int file, char path[PATH_MAX]) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    int before = errno;
    ssize_t length = readlink(link, path, PATH_MAX - 1);
    errno = before;
    path[length < 0 ? 0 : length] = 0;
    return path;
}

static int has_no_room_at(int file) {
    char path[PATH_MAX];
    return has_no_room(path_of(file, path));
}

static void wait_for(int file) {
    char path[PATH_MAX];
    const char *disk = getenv("HOST_TROUBLE_DISK");
    if (!disk || strncmp(path_of(file, path), disk, strlen(disk)) || !is_on("slow-disk")) return;
    struct timespec slow = {.tv_nsec = SLOW_NS};
    nanosleep(&slow, NULL);
}

int fsync(int file) {
    wait_for(file);
    return syscall(SYS_fsync, file);
}

int fdatasync(int file) {
    wait_for(file);
    return syscall(SYS_fdatasync, file);
}

static int opened(const char *path, int flags, mode_t mode) {
    if ((flags & (O_WRONLY | O_RDWR | O_CREAT)) && is_refused(path)) return -1;
    int is_there = syscall(SYS_faccessat, AT_FDCWD, path, F_OK) == 0;
    if ((flags & O_CREAT) && !is_there && has_no_room(path)) return -1;
    return syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

int open(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    return opened(path, flags, mode);
}

int open64(const char *path, int flags, ...) __attribute__((alias("open")));

ssize_t write(int file, const void *data, size_t size) {
    return has_no_room_at(file) ? -1 : syscall(SYS_write, file, data, size);
}

ssize_t pwrite64(int file, const void *data, size_t size, off_t at) {
    return has_no_room_at(file) ? -1 : syscall(SYS_pwrite64, file, data, size, at);
}

int ftruncate64(int file, off_t size) {
    return has_no_room_at(file) ? -1 : syscall(SYS_ftruncate, file, size);
}

int mkdir(const char *path, mode_t mode) {
    return has_no_room(path) ? -1 : syscall(SYS_mkdirat, AT_FDCWD, path, mode);
}

int rename(const char *from, const char *to) {
    return is_refused(to) ? -1 : syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, 0);
}

int unlink(const char *path) {
    return is_refused(path) ? -1 : syscall(SYS_unlinkat, AT_FDCWD, path, 0);
}
