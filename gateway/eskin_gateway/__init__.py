"""The gateway: authenticate, spool, acknowledge, republish, forward."""
