"""Monitoring: pairs of logs, before and after a known change."""
