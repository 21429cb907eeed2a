"""The report of one flight: one HTML file that loads nothing.

``write_report(folder, flight)`` writes ``report.html``. Each section is a module with
``section(flight, axis) -> Section | None``; :mod:`monitor.report.page` puts them in order.
"""

from monitor.report.page import REPORT, render, write_report

__all__ = ["REPORT", "render", "write_report"]
