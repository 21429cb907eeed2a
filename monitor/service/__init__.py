"""The daemon as a service: what it tells the service manager, and the log that programs read."""

from monitor.service.events import Event, EventLog, LogError, open_event_log
from monitor.service.notifier import Notifier

__all__ = ["Event", "EventLog", "LogError", "Notifier", "open_event_log"]
