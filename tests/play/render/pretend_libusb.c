/* Two bulk endpoints that are a socket: libusb_bulk_transfer, as libusb 1.0 describes it. */
#include <errno.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

enum { NO_DEVICE = -4, TIMED_OUT = -7 };

int pretend_bulk_transfer(void *handle, unsigned char endpoint, unsigned char *data, int length,
                          int *moved, unsigned timeout_ms)
{
    int fd = *(int *)handle;
    *moved = 0;
    if (endpoint & 0x80) {
        struct pollfd came = {fd, POLLIN, 0};
        if (poll(&came, 1, (int)timeout_ms) == 0)
            return TIMED_OUT;
        *moved = (int)recv(fd, data, (size_t)length, 0);
        return *moved > 0 ? 0 : NO_DEVICE;
    }
    while (*moved < length) {
        ssize_t n = send(fd, data + *moved, (size_t)(length - *moved), MSG_NOSIGNAL);
        if (n < 0 && errno == EAGAIN) {
            struct pollfd free = {fd, POLLOUT, 0};
            poll(&free, 1, 10);
        } else if (n <= 0)
            return NO_DEVICE;
        else
            *moved += (int)n;
    }
    return 0;
}
