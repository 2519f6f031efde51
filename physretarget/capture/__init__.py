"""Captures: files in, joints or markers over time out, and an actor fitted to them."""
