"""Tests of the dashboard in a real browser, against the real stack."""
