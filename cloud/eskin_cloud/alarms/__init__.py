"""Monitors over live data, and the alarms that they raise."""
