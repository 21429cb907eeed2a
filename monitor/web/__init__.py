"""The live page: a snapshot of the daemon a few times a second, to any number of viewers.

The daemon builds a snapshot and hands its bytes to a process of its own (:mod:`monitor.web.server`)
without ever waiting; that one serves the page, a WebSocket and Prometheus metrics.
"""
