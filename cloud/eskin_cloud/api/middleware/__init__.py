"""ASGI middleware of both listeners."""
