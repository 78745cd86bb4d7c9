"""Shapes of REST answers: Pydantic models and how rows become them."""
