/* Tells the service manager how it goes (systemd's notification protocol: a datagram to the socket
 * in $NOTIFY_SOCKET). Without such a socket nothing happens. */
#ifndef SC_CAPTURE_NOTIFY_H
#define SC_CAPTURE_NOTIFY_H

#ifdef __cplusplus
extern "C" {
#endif

/* Sends lines such as "READY=1", "WATCHDOG=1" or "STATUS=text". Never waits; failures are nobody's
 * business. Not for the real-time path. */
void notify_send(const char *lines);

#ifdef __cplusplus
}
#endif
#endif
