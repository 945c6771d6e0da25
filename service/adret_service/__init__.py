"""REST service around the Adret library."""
