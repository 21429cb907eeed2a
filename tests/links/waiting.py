"""For tests of links: wait for something that another thread or the system brings about."""

import time

WAIT_S = 5.0


def now_us():
    return time.monotonic_ns() // 1000


def until(true, *links):
    """Tend and read these links until it is true; what they brought meanwhile."""
    got = []
    deadline_s = time.monotonic() + WAIT_S
    while not true():
        assert time.monotonic() < deadline_s, "did not come about"
        for link in links:
            link.tend(now_us())
            got += [taken.data for taken in link.take(100)]
        time.sleep(0.002)
    return got


def wait_for(link, wanted):
    """Bytes received until there are ``wanted`` of them."""
    got = b""
    deadline_s = time.monotonic() + WAIT_S
    while len(got) < wanted and time.monotonic() < deadline_s:
        got += b"".join(data for data, _ in link.recv(0.05))
    return got
