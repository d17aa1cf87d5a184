/* A V4L2 device, for the one program that this library is preloaded into.
 *
 * Opening the file that $VIDEO_DEVICE names opens the device; the file itself describes it, one
 * property a line:
 *
 *     card NAME
 *     mode FOURCC WIDTH HEIGHT RATE...       one line a size, most preferred first; rates in Hz
 *     control ID MIN MAX DEFAULT READS NAME  ID in hexadecimal; READS: largest value read back
 *     refuses FOURCC                         listed, but another format is set in its place
 *     wedges                                 a change of rate while it streams: silent until replugged
 *
 * Frames come from the socket FILE.frames: on STREAMON the device asks there for
 * "FOURCC WIDTH HEIGHT RATE\n"; each frame is two 32-bit numbers (length in bytes, V4L2_BUF_FLAG_*)
 * and the bytes. The socket is the descriptor that the program waits on, so poll and select need
 * no part here. Its end is the end of the device, as when it is unplugged. FILE.wedged exists while
 * the device is wedged; FILE.calls lists each call that sets something.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define MOST 32
#define PLACE (64u << 20) /* distance of two buffers' offsets for mmap */

struct mode { __u32 fourcc, width, height, rate_count, rates[8]; };
struct control { __u32 id; int least, most, start, reads, value; char name[32]; };
struct buffer { unsigned char *start; int queued; };

static struct {
    int file, gone, streaming, wedges, mode_count, control_count;
    char card[32];
    struct mode modes[MOST];
    struct control controls[MOST];
    __u32 refused, fourcc, width, height, rate, sequence, buffer_count, next;
    struct buffer buffers[MOST];
} device = {.file = -1};
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static __u32 code_of(const char *text) { return v4l2_fourcc(text[0], text[1], text[2], text[3]); }

static const char *beside(const char *ending) {
    static char path[4096];
    snprintf(path, sizeof path, "%s.%s", getenv("VIDEO_DEVICE"), ending);
    return path;
}

static void note(const char *format, ...) {
    va_list rest;
    char line[200];
    va_start(rest, format);
    int length = vsnprintf(line, sizeof line, format, rest);
    va_end(rest);
    int log = syscall(SYS_openat, AT_FDCWD, beside("calls"), O_WRONLY | O_CREAT | O_APPEND, 0644);
    if (log >= 0 && write(log, line, length) != length) device.gone = 1;
    if (log >= 0) syscall(SYS_close, log);
}

static void describe(const char *path) {
    FILE *file = fopen(path, "r");
    char line[300], code[5];
    device.mode_count = device.control_count = device.wedges = device.refused = 0;
    while (file && fgets(line, sizeof line, file)) {
        struct mode mode = {0};
        struct control control = {0};
        int used = 0, more = 0;
        if (sscanf(line, "card %31[^\n]", device.card) == 1) continue;
        if (sscanf(line, "refuses %4s", code) == 1) device.refused = code_of(code);
        if (!strncmp(line, "wedges", 6)) device.wedges = 1;
        if (sscanf(line, "control %x %d %d %d %d %31[^\n]", &control.id, &control.least,
                   &control.most, &control.start, &control.reads, control.name) == 6) {
            control.value = control.start;
            device.controls[device.control_count++] = control;
        }
        if (sscanf(line, "mode %4c %u %u%n", code, &mode.width, &mode.height, &used) == 3) {
            mode.fourcc = code_of(code);
            while (sscanf(line + used, "%u%n", &mode.rates[mode.rate_count], &more) == 1) {
                mode.rate_count++;
                used += more;
            }
            device.modes[device.mode_count++] = mode;
        }
    }
    if (file) fclose(file);
    device.fourcc = device.modes[0].fourcc;
    device.width = device.modes[0].width;
    device.height = device.modes[0].height;
    device.rate = device.modes[0].rates[0];
}

static int connected(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    char folder[4096], *slash;
    snprintf(folder, sizeof folder, "%s", beside("frames"));
    slash = strrchr(folder, '/');
    *slash = 0;
    int place = syscall(SYS_openat, AT_FDCWD, folder, O_PATH | O_DIRECTORY, 0);
    snprintf(address.sun_path, sizeof address.sun_path, "/proc/self/fd/%d/%s", place, slash + 1);
    int line = socket(AF_UNIX, SOCK_STREAM, 0);
    if (connect(line, (struct sockaddr *)&address, sizeof address)) {
        syscall(SYS_close, line);
        line = -1;
    }
    syscall(SYS_close, place);
    return line;
}

static int is_wedged(void) { return syscall(SYS_faccessat, AT_FDCWD, beside("wedged"), F_OK) == 0; }

static int opened(const char *path, int flags, mode_t mode) {
    const char *wanted = getenv("VIDEO_DEVICE");
    char real[4096] = "", ours[4096] = "";
    if (!wanted || !realpath(path, real) || !realpath(wanted, ours) || strcmp(real, ours) ||
        (flags & O_ACCMODE) != O_RDWR)
        return syscall(SYS_openat, AT_FDCWD, path, flags, mode);
    pthread_mutex_lock(&lock);
    /* Held open, so that /proc shows who uses the device; a socket takes its place while it streams. */
    device.file = syscall(SYS_openat, AT_FDCWD, path, O_RDONLY, 0);
    device.gone = device.streaming = device.buffer_count = 0;
    describe(path);
    pthread_mutex_unlock(&lock);
    return device.file;
}

int open(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = va_arg(rest, mode_t);
    va_end(rest);
    return opened(path, flags, mode);
}

int open64(const char *path, int flags, ...) __attribute__((alias("open")));

int close(int file) {
    if (file >= 0 && file == device.file) device.file = -1;
    return syscall(SYS_close, file);
}

static __u32 bytes_of(__u32 fourcc, __u32 width, __u32 height) {
    if (fourcc == V4L2_PIX_FMT_GREY) return width * height;
    if (fourcc == V4L2_PIX_FMT_NV12) return width * height * 3 / 2;
    return width * height * 2;
}

void *mmap(void *address, size_t length, int protection, int flags, int file, off_t offset) {
    if (file < 0 || file != device.file)
        return (void *)syscall(SYS_mmap, address, length, protection, flags, file, offset);
    int memory = MAP_SHARED | MAP_ANONYMOUS;
    void *start = (void *)syscall(SYS_mmap, 0, length, PROT_READ | PROT_WRITE, memory, -1, 0);
    device.buffers[offset / PLACE].start = start;
    return start;
}

void *mmap64(void *, size_t, int, int, int, off_t) __attribute__((alias("mmap")));

static int distance(const struct mode *mode, __u32 width, __u32 height) {
    return abs((int)mode->width - (int)width) + abs((int)mode->height - (int)height);
}

/* The nearest size of the format, or of the most preferred format where there is none such. */
static const struct mode *nearest(__u32 fourcc, __u32 width, __u32 height) {
    const struct mode *found = NULL;
    for (int i = 0; i < device.mode_count; i++) {
        const struct mode *mode = &device.modes[i];
        if (mode->fourcc != fourcc || fourcc == device.refused) continue;
        if (!found || distance(mode, width, height) < distance(found, width, height)) found = mode;
    }
    if (found) return found;
    for (int i = 0; i < device.mode_count; i++)
        if (device.modes[i].fourcc != device.refused)
            return nearest(device.modes[i].fourcc, width, height);
    return NULL;
}

static int set_format(struct v4l2_format *format, int only_asked) {
    struct v4l2_pix_format *pix = &format->fmt.pix;
    if (format->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
    const struct mode *mode = nearest(pix->pixelformat, pix->width, pix->height);
    if (!mode) return EINVAL;
    if (!only_asked && device.buffer_count) return EBUSY;
    pix->pixelformat = mode->fourcc;
    pix->width = mode->width;
    pix->height = mode->height;
    pix->field = V4L2_FIELD_NONE;
    pix->bytesperline = mode->fourcc == V4L2_PIX_FMT_YUYV ? 2 * mode->width : mode->width;
    pix->sizeimage = bytes_of(mode->fourcc, mode->width, mode->height);
    if (only_asked) return 0;
    device.fourcc = mode->fourcc;
    device.width = mode->width;
    device.height = mode->height;
    device.rate = mode->rates[0];
    note("format %.4s %u %u\n", (char *)&mode->fourcc, mode->width, mode->height);
    return 0;
}

static int set_rate(struct v4l2_fract *time) {
    const struct mode *mode = nearest(device.fourcc, device.width, device.height);
    double asked = time->numerator ? (double)time->denominator / time->numerator : mode->rates[0];
    __u32 rate = mode->rates[0];
    for (__u32 i = 0; i < mode->rate_count; i++) {
        double off = mode->rates[i] > asked ? mode->rates[i] - asked : asked - mode->rates[i];
        double best = rate > asked ? rate - asked : asked - rate;
        if (off < best) rate = mode->rates[i];
    }
    if (device.streaming && !device.wedges) return EBUSY;
    if (device.streaming && rate != device.rate) {
        int mark = syscall(SYS_openat, AT_FDCWD, beside("wedged"), O_WRONLY | O_CREAT, 0644);
        if (mark >= 0) syscall(SYS_close, mark);
    }
    note("rate %u%s\n", rate, device.streaming ? " while it streams" : "");
    device.rate = rate;
    time->numerator = 1;
    time->denominator = rate;
    return 0;
}

static struct control *control_of(__u32 id) {
    for (int i = 0; i < device.control_count; i++)
        if (device.controls[i].id == id) return &device.controls[i];
    return NULL;
}

static int streaming(int on) {
    char ask[64];
    if (on == device.streaming) return 0;
    note("stream %s\n", on ? "on" : "off");
    int line = on ? connected() : syscall(SYS_openat, AT_FDCWD, getenv("VIDEO_DEVICE"), O_RDONLY, 0);
    if (line < 0) {
        device.gone = 1;
        return ENODEV;
    }
    syscall(SYS_dup3, line, device.file, 0);
    syscall(SYS_close, line);
    device.streaming = on;
    device.sequence = device.next = 0;
    for (int i = 0; i < MOST && !on; i++) device.buffers[i].queued = 0;
    int length = snprintf(ask, sizeof ask, "%.4s %u %u %u\n", (char *)&device.fourcc, device.width,
                          device.height, is_wedged() ? 0 : device.rate);
    if (on && send(device.file, ask, length, MSG_NOSIGNAL) != length) return ENODEV;
    return 0;
}

static int dequeue(struct v4l2_buffer *buffer) {
    struct { __u32 length, flags; } head;
    struct timespec now;
    if (!device.streaming) return EINVAL;
    ssize_t got = recv(device.file, &head, sizeof head, MSG_DONTWAIT | MSG_PEEK);
    if (got > 0 ? got < (ssize_t)sizeof head : got < 0 && errno == EAGAIN) return EAGAIN;
    if (got <= 0) {
        device.gone = 1;
        return ENODEV;
    }
    __u32 room = bytes_of(device.fourcc, device.width, device.height);
    for (__u32 tried = 0; tried < device.buffer_count; tried++) {
        __u32 index = (device.next + tried) % device.buffer_count;
        if (!device.buffers[index].queued) continue;
        device.next = index + 1;
        recv(device.file, &head, sizeof head, MSG_WAITALL);
        if (head.length > room ||
            recv(device.file, device.buffers[index].start, head.length, MSG_WAITALL) !=
                (ssize_t)head.length)
            return ENODEV;
        device.buffers[index].queued = 0;
        syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &now);
        buffer->index = index;
        buffer->bytesused = head.length;
        buffer->length = room;
        buffer->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_MAPPED | head.flags;
        buffer->field = V4L2_FIELD_NONE;
        buffer->timestamp.tv_sec = now.tv_sec;
        buffer->timestamp.tv_usec = now.tv_nsec / 1000;
        buffer->sequence = device.sequence++;
        return 0;
    }
    return EAGAIN;
}

static int list_format(struct v4l2_fmtdesc *format) {
    __u32 index = format->index;
    for (int i = 0; i < device.mode_count; i++) {
        if (i && device.modes[i].fourcc == device.modes[i - 1].fourcc) continue;
        if (index--) continue;
        format->pixelformat = device.modes[i].fourcc;
        format->flags = format->pixelformat == V4L2_PIX_FMT_MJPEG ? V4L2_FMT_FLAG_COMPRESSED : 0;
        snprintf((char *)format->description, 32, "%.4s", (char *)&format->pixelformat);
        return 0;
    }
    return EINVAL;
}

static int list_size(struct v4l2_frmsizeenum *size) {
    __u32 index = size->index;
    for (int i = 0; i < device.mode_count; i++) {
        if (device.modes[i].fourcc != size->pixel_format || index--) continue;
        size->type = V4L2_FRMSIZE_TYPE_DISCRETE;
        size->discrete.width = device.modes[i].width;
        size->discrete.height = device.modes[i].height;
        return 0;
    }
    return EINVAL;
}

static int list_interval(struct v4l2_frmivalenum *interval) {
    for (int i = 0; i < device.mode_count; i++) {
        const struct mode *mode = &device.modes[i];
        if (mode->fourcc != interval->pixel_format || mode->width != interval->width ||
            mode->height != interval->height || interval->index >= mode->rate_count)
            continue;
        interval->type = V4L2_FRMIVAL_TYPE_DISCRETE;
        interval->discrete.numerator = 1;
        interval->discrete.denominator = mode->rates[interval->index];
        return 0;
    }
    return EINVAL;
}

static int capability(struct v4l2_capability *found) {
    strcpy((char *)found->driver, "emulated"); /* so that nobody takes it for a real one */
    strcpy((char *)found->card, device.card);
    strcpy((char *)found->bus_info, "usb-0000:00:14.0-3");
    found->device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
    found->capabilities = found->device_caps | V4L2_CAP_DEVICE_CAPS;
    return 0;
}

static int query(struct v4l2_queryctrl *found) {
    const struct control *control = control_of(found->id);
    if (!control) return EINVAL;
    snprintf((char *)found->name, 32, "%s", control->name);
    found->type = V4L2_CTRL_TYPE_INTEGER;
    found->minimum = control->least;
    found->maximum = control->most;
    found->step = 1;
    found->default_value = control->start;
    return 0;
}

static int set_control(struct v4l2_control *asked) {
    struct control *control = control_of(asked->id);
    if (!control) return EINVAL;
    control->value = asked->value < control->least  ? control->least
                     : asked->value > control->most ? control->most
                                                    : asked->value;
    note("control %x %d\n", control->id, control->value);
    return 0;
}

static int get_control(struct v4l2_control *asked) {
    const struct control *control = control_of(asked->id);
    if (!control) return EINVAL;
    asked->value = control->value > control->reads ? control->reads : control->value;
    return 0;
}

static int request_buffers(struct v4l2_requestbuffers *asked) {
    if (asked->memory != V4L2_MEMORY_MMAP) return EINVAL;
    if (asked->count > MOST) asked->count = MOST;
    device.buffer_count = asked->count;
    return asked->count ? 0 : streaming(0);
}

static int query_buffer(struct v4l2_buffer *buffer) {
    if (buffer->index >= device.buffer_count) return EINVAL;
    buffer->length = bytes_of(device.fourcc, device.width, device.height);
    buffer->m.offset = buffer->index * PLACE;
    return 0;
}

static int queue(struct v4l2_buffer *buffer) {
    if (buffer->index >= device.buffer_count) return EINVAL;
    device.buffers[buffer->index].queued = 1;
    return 0;
}

static int get_format(struct v4l2_format *format) {
    format->fmt.pix.pixelformat = device.fourcc;
    format->fmt.pix.width = device.width;
    format->fmt.pix.height = device.height;
    return set_format(format, 1);
}

static int parameters(struct v4l2_streamparm *asked, int is_set) {
    struct v4l2_captureparm *capture = &asked->parm.capture;
    if (asked->type != V4L2_BUF_TYPE_VIDEO_CAPTURE) return EINVAL;
    capture->capability = V4L2_CAP_TIMEPERFRAME;
    if (is_set) return set_rate(&capture->timeperframe);
    capture->timeperframe.numerator = 1;
    capture->timeperframe.denominator = device.rate;
    return 0;
}

static int answer(unsigned long request, void *data) {
    if (device.gone) return ENODEV;
    switch (request) {
    case VIDIOC_QUERYCAP: return capability(data);
    case VIDIOC_ENUM_FMT: return list_format(data);
    case VIDIOC_ENUM_FRAMESIZES: return list_size(data);
    case VIDIOC_ENUM_FRAMEINTERVALS: return list_interval(data);
    case VIDIOC_G_FMT: return get_format(data);
    case VIDIOC_S_FMT: return set_format(data, 0);
    case VIDIOC_TRY_FMT: return set_format(data, 1);
    case VIDIOC_G_PARM: return parameters(data, 0);
    case VIDIOC_S_PARM: return parameters(data, 1);
    case VIDIOC_REQBUFS: return request_buffers(data);
    case VIDIOC_QUERYBUF: return query_buffer(data);
    case VIDIOC_QBUF: return queue(data);
    case VIDIOC_DQBUF: return dequeue(data);
    case VIDIOC_STREAMON: return streaming(1);
    case VIDIOC_STREAMOFF: return streaming(0);
    case VIDIOC_QUERYCTRL: return query(data);
    case VIDIOC_G_CTRL: return get_control(data);
    case VIDIOC_S_CTRL: return set_control(data);
    default: return ENOTTY;
    }
}

int ioctl(int file, unsigned long request, ...) {
    va_list rest;
    va_start(rest, request);
    void *data = va_arg(rest, void *);
    va_end(rest);
    if (file < 0 || file != device.file) return syscall(SYS_ioctl, file, request, data);
    pthread_mutex_lock(&lock);
    /* Python's ioctl passes the request as a signed int. */
    int problem = answer(request & 0xffffffff, data);
    pthread_mutex_unlock(&lock);
    if (!problem) return 0;
    errno = problem;
    return -1;
}
