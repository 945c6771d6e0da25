"""Compiled loops over depth buffers, one module a method."""
