"""The public conformance suite's assertions, against a real server."""
