"""The wire contract: messages, envelopes, topics (``docs/eskin.cddl``)."""
